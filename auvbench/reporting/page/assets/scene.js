// Draw the water volume and the paths on a canvas. World frame ENU in metres: x east, y north, z up.
const Scene = (() => {
  "use strict";
  const { DASHES, palette, contrast, prepare, halo, text } = Pen;

  /** Return the paths of all vehicles: the first vehicle of each track, and the other vehicles of the track's team. */
  const vehicles = (tracks) => tracks.flatMap((track) => [track, ...track.mates]);

  /** Return the box around start, goal, reference and shown paths, in whole grid steps. In the waypoint task, it has the full depth. */
  function bounds({ world, waypoint, start, guide, tracks }) {
    const whole = world.goal === "waypoint";
    const [bottom, top] = [world.depth[0], Math.max(world.depth[1], 0)];
    const sides = whole ? [0, 1] : [0, 1, 2];
    const low = whole ? [-20, -20, bottom] : [...waypoint];
    const high = whole ? [20, 20, top] : [...waypoint];
    const take = (points, around = 0) => {
      for (let i = 0; i < points.length; i += 3) for (const k of sides) {
        low[k] = Math.min(low[k], points[i + k] - around);
        high[k] = Math.max(high[k], points[i + k] + around);
      }
    };
    take(start);
    take(waypoint, whole ? 0 : Math.max(0.5, world.goal_radius, world.reach));
    for (const points of [...(guide ? [guide] : []), ...vehicles(tracks).map((track) => track.xyz)]) take(points);
    const span = Math.max(...sides.map((k) => high[k] - low[k]));
    const step = span > 160 ? 50 : whole || span > 40 ? 10 : span > 16 ? 5 : span > 8 ? 2 : 1;
    for (const k of sides) {
      low[k] = Math.floor(low[k] / step) * step;
      high[k] = Math.ceil(high[k] / step) * step;
    }
    [low[2], high[2]] = [Math.max(low[2], bottom), Math.min(high[2], top)];
    return { low, high, step, planes: whole ? world.depth : [low[2], high[2]], rise: whole ? 10 : step };
  }

  function line(context, project, points) {
    context.beginPath();
    let pen = false;
    for (const point of points) {
      const at = project(point);
      if (!at) { pen = false; continue; }
      if (pen) context.lineTo(at[0], at[1]);
      else context.moveTo(at[0], at[1]);
      pen = true;
    }
    context.stroke();
  }

  function plane(context, project, box, z, colours, fill) {
    const { low, high, step } = box;
    const edge = [[low[0], low[1], z], [high[0], low[1], z], [high[0], high[1], z], [low[0], high[1], z]].map(project);
    if (edge.every(Boolean)) {
      context.beginPath();
      edge.forEach((p, i) => (i ? context.lineTo(p[0], p[1]) : context.moveTo(p[0], p[1])));
      context.closePath();
      context.globalAlpha = fill;
      context.fillStyle = colours.water;
      context.fill();
    }
    context.globalAlpha = 0.55;
    context.strokeStyle = colours.rule;
    context.lineWidth = 1;
    for (let x = low[0]; x <= high[0]; x += step) line(context, project, [[x, low[1], z], [x, high[1], z]]);
    for (let y = low[1]; y <= high[1]; y += step) line(context, project, [[low[0], y, z], [high[0], y, z]]);
    context.globalAlpha = 1;
  }

  /** Label a depth limit at the rightmost corner of the limit's plane. */
  function limit(context, project, box, z, colours) {
    const { low, high } = box;
    const seen = [[low[0], low[1], z], [high[0], low[1], z], [high[0], high[1], z], [low[0], high[1], z]].map(project).filter(Boolean);
    if (!seen.length) return;
    const at = seen.reduce((best, p) => (p[0] > best[0] ? p : best));
    context.fillStyle = colours.water;
    context.textAlign = "left";
    context.textBaseline = "middle";
    context.fillText(`limit ${text(z)} m`, at[0] + 8, at[1]);
  }

  /** Draw tick labels along one edge of the box, unless the edge is too short in the picture. */
  function axis(context, project, from, to, values, along, name, shift, colours, taken) {
    const [a, b] = [project(from), project(to)];
    if (!a || !b || Math.hypot(b[0] - a[0], b[1] - a[1]) < 48) return;
    const room = Math.hypot(b[0] - a[0], b[1] - a[1]) / Math.max(1, values.length - 1);
    const every = Math.max(1, Math.ceil(26 / room));
    context.fillStyle = colours.soft;
    context.textAlign = shift[0] < 0 ? "right" : shift[0] > 0 ? "left" : "center";
    context.textBaseline = "middle";
    values.forEach((value, i) => {
      if (i % every) return;
      const point = [...from];
      point[along] = value;
      const at = project(point);
      if (!at) return;
      const label = [at[0] + shift[0], at[1] + shift[1]];
      // Two axes share a corner; only the first axis labels the corner.
      if (taken.some((other) => Math.abs(other[0] - label[0]) < 30 && Math.abs(other[1] - label[1]) < 19)) return;
      taken.push(label);
      context.fillText(text(value), ...label);
    });
    context.fillStyle = colours.ink;
    if (along === 2) context.fillText(name, b[0] + 12, b[1] - 16);
    else context.fillText(name, (a[0] + b[0]) / 2 + shift[0] * 3.4, (a[1] + b[1]) / 2 + shift[1] * 2.3);
  }

  function range(low, high, step) {
    const values = [];
    for (let v = Math.ceil(low / step) * step; v <= high + 1e-9; v += step) values.push(v);
    return values;
  }

  function axes(context, project, camera, box, colours) {
    const { low, high, step, rise } = box;
    const { back } = camera.axes();
    const taken = [];
    // Label the edges nearest to the camera, so that labels do not cover the paths.
    const x = back[0] >= 0 ? high[0] : low[0];
    const y = back[1] > 0 ? high[1] : low[1];
    const z = box.planes[0];
    const centre = project([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, z]);
    const side = (p) => (p && centre ? Math.sign(Math.round((p[0] - centre[0]) / 25)) : 0);
    const drop = camera.elevation >= -0.05 ? 15 : -15;
    const middleX = project([(low[0] + high[0]) / 2, y, z]);
    const middleY = project([x, (low[1] + high[1]) / 2, z]);
    axis(context, project, [low[0], y, z], [high[0], y, z], range(low[0], high[0], step), 0, "east, m", [side(middleX) * 10, drop], colours, taken);
    const above = camera.flat && camera.elevation > 1;
    axis(context, project, [x, low[1], z], [x, high[1], z], range(low[1], high[1], step), 1, "north, m", above ? [12, 0] : [side(middleY) * 10, drop], colours, taken);
    // Draw the depth labels at the box's leftmost vertical edge.
    const edges = [[low[0], low[1]], [low[0], high[1]], [high[0], low[1]], [high[0], high[1]]];
    const seen = edges.map((edge) => ({ edge, at: project([...edge, z]) })).filter((entry) => entry.at);
    seen.sort((a, b) => a.at[0] - b.at[0]);
    if (!seen.length || above) return;
    const [ex, ey] = seen[0].edge;
    context.strokeStyle = colours.rule;
    line(context, project, [[ex, ey, z], [ex, ey, high[2]]]);
    const depths = range(z, high[2], rise).map(Math.round);
    axis(context, project, [ex, ey, z], [ex, ey, high[2]], depths, 2, "up, m", [-9, 0], colours, taken);
  }

  /** Draw the solids of a world as line segments. */
  function solids(context, project, points, colours) {
    context.strokeStyle = colours.soft;
    context.lineWidth = 0.8;
    context.globalAlpha = 0.45;
    for (let i = 0; i < points.length; i += 6) line(context, project, [points.slice(i, i + 3), points.slice(i + 3, i + 6)]);
    context.globalAlpha = 1;
  }

  const TURN = Array.from({ length: 49 }, (_, i) => (i * Math.PI) / 24);

  /** Draw the goal sphere around the waypoint: outline, equator and two meridians. */
  function goal(context, project, waypoint, radius, colours) {
    const centre = project(waypoint);
    if (!centre) return;
    context.beginPath();
    context.arc(centre[0], centre[1], radius * centre[2], 0, 2 * Math.PI);
    context.globalAlpha = 0.16;
    context.fillStyle = colours.water;
    context.fill();
    context.globalAlpha = 0.85;
    context.strokeStyle = colours.water;
    context.lineWidth = 1.2;
    context.stroke();
    context.globalAlpha = 0.5;
    context.lineWidth = 0.8;
    const circle = (place) => line(context, project, TURN.map((t) => place(radius * Math.cos(t), radius * Math.sin(t))));
    const [x, y, z] = waypoint;
    circle((a, b) => [x + a, y + b, z]);
    circle((a, b) => [x + a, y, z + b]);
    circle((a, b) => [x, y + a, z + b]);
    context.globalAlpha = 1;
  }

  /** Draw the cone through which a vehicle may enter a dock, and the cone's axis. `yaw` is the yaw of an entering vehicle. */
  function dock(context, project, [x, y, z], yaw, world, colours) {
    const [ax, ay] = [-Math.cos(yaw), -Math.sin(yaw)];
    const wide = world.reach * Math.tan(world.cone);
    const rim = TURN.map((t) => [
      x + world.reach * ax - wide * Math.cos(t) * ay, y + world.reach * ay + wide * Math.cos(t) * ax, z + wide * Math.sin(t)]);
    context.strokeStyle = colours.water;
    context.lineWidth = 1.2;
    context.globalAlpha = 0.7;
    line(context, project, rim);
    for (let i = 0; i < 48; i += 6) line(context, project, [[x, y, z], rim[i]]);
    context.setLineDash([7, 4, 2, 4]);
    line(context, project, [[x, y, z], [x + 1.3 * world.reach * ax, y + 1.3 * world.reach * ay, z]]);
    context.setLineDash([]);
    context.globalAlpha = 1;
  }

  /** Draw the path of a moving reference over the whole episode. */
  function reference(context, project, guide, colours) {
    const points = [];
    for (let i = 0; i < guide.length; i += 3) points.push([guide[i], guide[i + 1], guide[i + 2]]);
    context.strokeStyle = colours.ink;
    context.lineWidth = 1.2;
    context.globalAlpha = 0.6;
    context.setLineDash([5, 4]);
    line(context, project, points);
    context.setLineDash([]);
    context.globalAlpha = 1;
  }

  /** Draw a ring at the current position of a track's reference. */
  function aim(context, project, track, time) {
    const at = project(position({ ...track, xyz: track.guide }, time));
    if (!at) return;
    context.strokeStyle = track.colour;
    context.lineWidth = 1.5;
    context.beginPath();
    context.arc(at[0], at[1], 8, 0, 2 * Math.PI);
    context.stroke();
  }

  function mark(context, at, name, colours, shift) {
    context.fillStyle = colours.ink;
    context.textAlign = "center";
    context.textBaseline = "bottom";
    context.lineWidth = 3;
    context.strokeStyle = colours.raised;
    context.strokeText(name, at[0], at[1] - shift + 6);
    context.fillText(name, at[0], at[1] - shift + 6);
  }

  /** Return the position (m) of a track at a time (s). */
  function position(track, time) {
    const { xyz, dt, end } = track;
    const last = xyz.length / 3 - 1;
    const t = Math.min(time, end);
    if (last < 1 || dt <= 0) return [xyz[0], xyz[1], xyz[2]];
    const i = Math.min(Math.floor(t / dt), last - 1);
    const [from, to] = [i * dt, Math.min((i + 1) * dt, end)];
    const part = to > from ? Math.min(1, (t - from) / (to - from)) : 1;
    return [0, 1, 2].map((k) => xyz[3 * i + k] + part * (xyz[3 * i + 3 + k] - xyz[3 * i + k]));
  }

  /** Return the points of a track up to a time; with `after`, the points from this time on. */
  function stretch(track, time, after) {
    const { xyz, dt } = track;
    const at = position(track, time);
    const found = after ? [at] : [];
    for (let i = 0; i < xyz.length / 3; i++) {
      if (i * dt > time === after) found.push([xyz[3 * i], xyz[3 * i + 1], xyz[3 * i + 2]]);
    }
    if (!after) found.push(at);
    return found;
  }

  function path(context, project, track, time, ground, colours) {
    const past = stretch(track, time, false);
    context.strokeStyle = track.colour;
    context.globalAlpha = 0.13;
    context.lineWidth = 1;
    line(context, project, past.map((p) => [p[0], p[1], ground]));
    if (time < track.end) {
      context.globalAlpha = 0.28;
      context.lineWidth = 1.2;
      line(context, project, stretch(track, time, true));
    }
    context.globalAlpha = 1;
    if (contrast(track.colour, colours.raised) < 2) halo(context, colours, 4.2, () => line(context, project, past));
    context.strokeStyle = track.colour;
    context.lineWidth = track.isMate ? 1.2 : 2.2;
    context.setLineDash(DASHES[track.dash] ?? []);
    line(context, project, past);
    context.setLineDash([]);
  }

  /** Draw the vehicle: a dot during the episode and after success, a square after a timeout, a cross after another failure. */
  function vehicle(context, project, track, time, colours) {
    const at = project(position(track, time));
    if (!at) return;
    const ended = time >= track.end - 1e-9;
    context.fillStyle = track.colour;
    context.strokeStyle = colours.raised;
    context.lineWidth = 1.5;
    const [x, y] = at;
    if (ended && ["collision", "out_of_bounds"].includes(track.outcome)) {
      for (const [colour, width] of [[colours.raised, 5], [track.colour, 2.6]]) {
        context.strokeStyle = colour;
        context.lineWidth = width;
        context.beginPath();
        context.moveTo(x - 5, y - 5); context.lineTo(x + 5, y + 5);
        context.moveTo(x + 5, y - 5); context.lineTo(x - 5, y + 5);
        context.stroke();
      }
      return;
    }
    context.beginPath();
    if (ended && track.outcome === "timeout") context.rect(x - 4.5, y - 4.5, 9, 9);
    else context.arc(x, y, 5, 0, 2 * Math.PI);
    context.fill();
    context.stroke();
  }

  /**
   * Draw everything. `show` = {world, waypoint, start, dock, guide, outlines, tracks, time}. Three entries may be undefined: `dock`,
   * the yaw of a dock; `guide`, the points of a moving reference; `outlines`, the end points of the segments that show solids.
   */
  function draw(canvas, camera, show) {
    const { context, width, height } = prepare(canvas);
    const { world, waypoint, tracks, time, dock: yaw, guide } = show;
    const colours = palette();
    const project = camera.projector(width, height);
    const box = bounds(show);
    const below = camera.elevation < 0;
    plane(context, project, box, box.planes[below ? 1 : 0], colours, 0.08);
    axes(context, project, camera, box, colours);
    goal(context, project, waypoint, world.goal_radius, colours);
    if (yaw !== undefined) dock(context, project, waypoint, yaw, world, colours);
    if (show.outlines) solids(context, project, show.outlines, colours);
    if (guide) reference(context, project, guide, colours);
    const start = project(show.start);
    if (start) {
      context.strokeStyle = colours.ink;
      context.lineWidth = 1.5;
      context.beginPath();
      context.arc(start[0], start[1], 4, 0, 2 * Math.PI);
      context.stroke();
    }
    for (const track of vehicles(tracks)) path(context, project, track, time, box.planes[0], colours);
    for (const track of tracks) if (track.guide) aim(context, project, track, time);
    for (const track of vehicles(tracks)) vehicle(context, project, track, time, colours);
    if (start) mark(context, start, "start", colours, 12);
    const reached = project(waypoint);
    if (reached) mark(context, reached, yaw === undefined ? world.goal : "dock", colours, world.goal_radius * reached[2] + 10);
    plane(context, project, box, box.planes[below ? 0 : 1], colours, 0.04);
    const limits = world.depth.filter((z) => box.planes.includes(z));
    if (!(camera.flat && camera.elevation > 1)) for (const z of limits) limit(context, project, box, z, colours);
    return box;
  }

  return { bounds, draw, position };
})();
