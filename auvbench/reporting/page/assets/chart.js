// Chart under the picture of one signal over time, such as the distance to the waypoint, goal or moving reference.
const Chart = (() => {
  "use strict";
  const { DASHES, palette, contrast, prepare, halo, text } = Pen;

  /** Draw a signal over time, and a vertical line at the time that the picture shows. */
  function draw(canvas, show) {
    const { context, width, height } = prepare(canvas);
    const { world, tracks, time, longest, guide, signal } = show;
    const toGoal = signal.name === "distance";
    const colours = palette();
    const area = { left: 40, right: width - 12, top: 12, bottom: height - 30 };
    let [least, most] = toGoal ? [0, world.goal === "waypoint" ? 10 : 1] : [Infinity, -Infinity];
    for (const track of tracks) {
      for (const d of signal.of(track)) [least, most] = [Math.min(least, d), Math.max(most, d)];
    }
    if (least > most) [least, most] = [0, 1];
    if (!toGoal && most - least < 1e-3) [least, most] = [least - 0.5, most + 0.5];
    const x = (t) => area.left + ((area.right - area.left) * t) / (longest || 1);
    const y = (d) => area.bottom - ((area.bottom - area.top) * (d - least)) / (most - least);
    context.fillStyle = colours.soft;
    context.lineWidth = 1;
    const steps = toGoal ? [0.5, 1, 2, 5, 10, 20, 50] : [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000];
    const step = steps.find((s) => (most - least) / s <= (toGoal ? 3 : 4)) ?? Math.max(50, Math.ceil((most - least) / 3));
    for (let k = Math.ceil(least / step); k * step <= most; k += 1) {
      const d = Number((k * step).toFixed(3));
      context.strokeStyle = colours.rule;
      context.globalAlpha = d ? 0.5 : 1;
      stroke(context, [[area.left, y(d)], [area.right, y(d)]]);
      context.globalAlpha = 1;
      context.textAlign = "right";
      context.textBaseline = "middle";
      context.fillText(text(d), area.left - 7, y(d));
    }
    const ticks = [1, 2, 5, 10, 20, 50, 100, 200, 500].find((s) => longest / s <= Math.max(3, width / 90)) ?? 1000;
    context.textBaseline = "top";
    context.textAlign = "center";
    for (let t = 0; t <= longest; t += ticks) context.fillText(text(t), x(t), area.bottom + 5);
    context.textAlign = "right";
    context.fillStyle = colours.ink;
    context.fillText("time, s", area.right, area.bottom + 17);
    context.textAlign = "left";
    context.fillText(signal.label, area.left + 6, 0);
    if (toGoal && !guide) {
      context.strokeStyle = colours.water;
      context.setLineDash([4, 3]);
      stroke(context, [[area.left, y(world.goal_radius)], [area.right, y(world.goal_radius)]]);
      context.setLineDash([]);
    }
    for (const track of tracks) {
      const points = Array.from(signal.of(track), (d, i) => [x(Math.min(i * track.dt, track.end)), y(d)]);
      if (contrast(track.colour, colours.raised) < 2) halo(context, colours, 3.6, () => stroke(context, points));
      context.strokeStyle = track.colour;
      context.lineWidth = 1.6;
      context.setLineDash(DASHES[track.dash] ?? []);
      stroke(context, points);
      context.setLineDash([]);
    }
    context.setLineDash([]);
    context.strokeStyle = colours.ink;
    context.lineWidth = 1;
    stroke(context, [[x(time), area.top], [x(time), area.bottom]]);
    return { toTime: (px) => Math.max(0, Math.min(longest, ((px - area.left) / (area.right - area.left)) * longest)) };
  }

  function stroke(context, points) {
    context.beginPath();
    points.forEach(([px, py], i) => (i ? context.lineTo(px, py) : context.moveTo(px, py)));
    context.stroke();
  }

  return { draw };
})();
