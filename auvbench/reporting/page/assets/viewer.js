// Controls of the 3-D view: episode, shown paths, camera and time.
(() => {
  "use strict";
  const holder = document.getElementById("data");
  if (!holder) return;
  const world = JSON.parse(holder.textContent);
  const by = (id) => document.getElementById(id);
  const [canvas, plot, picker, clock, play] = ["scene", "distance", "episode", "clock", "play"].map(by);
  const signals = by("signal");
  const body = by("tracks").tBodies[0];
  const PLAY_SECONDS = 9;

  const camera = new Camera();
  const chosen = new Set(); // run ids
  let episode = world.episodes[0];
  let tracks = [];
  let time = 0;
  let toTime = null;
  let queued = false;

  function metres(text, unit) {
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    const view = new DataView(bytes.buffer);
    return Float32Array.from({ length: bytes.length / 2 }, (_, i) => view.getInt16(2 * i, true) * unit);
  }

  /** Unpack a track once: positions in metres, and distances to the reference or to the goal. */
  function unpack(track, waypoint) {
    if (track.xyz) return track;
    track.xyz = metres(track.points, track.unit);
    if (track.reference) track.guide = metres(track.reference, track.unit);
    track.distance = Float32Array.from({ length: track.xyz.length / 3 }, (_, i) =>
      Math.hypot(...[0, 1, 2].map((k) => track.xyz[3 * i + k] - (track.guide ? track.guide[3 * i + k] : waypoint[k]))));
    Object.assign(track, { colour: world.agents[track.agent].colour, dash: world.agents[track.agent].dash });
    track.mates = (track.others ?? []).map((line) => ({ ...track, xyz: metres(line, track.unit), isMate: true }));
    return track;
  }

  /** Return a function that gives one coordinate of a track's positions: 0 east, 1 north, 2 up. */
  const axis = (k) => (track) => Float32Array.from({ length: track.xyz.length / 3 }, (_, i) => track.xyz[3 * i + k]);
  /** Return the smallest distance between any two vehicles of a team at each point. */
  const separation = ({ xyz, mates }) => {
    const lines = [xyz, ...mates.map((mate) => mate.xyz)];
    const apart = (a, b, i) => Math.hypot(...[0, 1, 2].map((k) => a[3 * i + k] - b[3 * i + k]));
    return Float32Array.from({ length: mates.length ? xyz.length / 3 : 0 }, (_, i) =>
      Math.min(...lines.flatMap((a, n) => lines.slice(n + 1).map((b) => apart(a, b, i)))));
  };
  const stored = (name) => (track) => (track.signals?.[name] ? metres(track.signals[name], track.units[name]) : new Float32Array());
  const SIGNALS = [
    ["distance", "distance, m", (track) => track.distance],
    ["up", "height, m (0: the surface)", axis(2)],
    ["east", "east, m", axis(0)],
    ["north", "north, m", axis(1)],
    ["speed", "speed, m/s", stored("speed")],
    ["yaw", "heading, degrees", stored("yaw")],
    ["command", "commanded force, N", stored("command")],
    ["separation", "smallest separation, m", separation],
  ].map(([name, label, make]) => ({ name, label, of: (track) => ((track.drawn ??= {})[name] ??= make(track)) }));

  /** Return the signal that the user chose. */
  function signal(guided) {
    const chosenSignal = SIGNALS.find((entry) => entry.name === signals.value) ?? SIGNALS[0];
    return chosenSignal.name === "distance"
      ? { ...chosenSignal, label: `distance to the ${guided ? "reference" : world.goal}, m` }
      : chosenSignal;
  }

  /** Return the end points (m) of the segments that show an episode's solids; undefined in open water. */
  function outlines(of) {
    if (of.outlines && !of.segments) of.segments = metres(of.outlines, of.outlines_unit);
    return of.segments;
  }

  const shown = () => tracks.filter((track) => chosen.has(track.run));
  const longest = () => Math.max(0, ...(shown().length ? shown() : tracks).map((track) => track.end));

  function scene() {
    const guided = tracks.filter((track) => track.guide).sort((a, b) => b.end - a.end);
    return {
      world, waypoint: episode.waypoint, dock: episode.dock_yaw, guide: guided[0]?.guide, outlines: outlines(episode), start: tracks[0].xyz.slice(0, 3),
      tracks: shown(), time, longest: longest(), signal: signal(guided.length > 0),
    };
  }

  function draw() {
    queued = false;
    const show = scene();
    Scene.draw(canvas, camera, show);
    toTime = Chart.draw(plot, show).toTime;
    by("now").value = `${time.toFixed(1)} s of ${longest().toFixed(1)} s`;
    for (const row of body.rows) {
      const track = tracks[Number(row.dataset.track)];
      const to = track.guide ? Scene.position({ ...track, xyz: track.guide }, time) : episode.waypoint;
      const at = Scene.position(track, time);
      row.cells[3].textContent = Math.hypot(at[0] - to[0], at[1] - to[1], at[2] - to[2]).toFixed(1);
    }
  }

  function redraw() {
    if (!queued) requestAnimationFrame(draw);
    queued = true;
  }

  function setTime(value) {
    time = Math.max(0, Math.min(longest(), value));
    clock.value = String(longest() ? Math.round((1000 * time) / longest()) : 1000);
    clock.setAttribute("aria-valuetext", `${time.toFixed(1)} seconds`);
    redraw();
  }

  /** Change which paths are shown. If the clock is at the end of the episode, it stays at the end. */
  function keepEnd(change) {
    const ended = time >= longest();
    change();
    setTime(ended ? longest() : time);
  }

  function fit() {
    camera.fit(Scene.bounds(scene()), canvas.clientWidth, canvas.clientHeight);
    redraw();
  }

  /** Return a short line in the colour and style of a path, as in a legend. */
  function key(track) {
    const line = document.createElement("span");
    line.className = "key";
    line.style.borderTop = `3px ${track.dash === "dashdot" ? "dashed" : track.dash} ${track.colour}`;
    return line;
  }

  function cell(row, kind, content) {
    const made = row.insertCell();
    made.className = kind;
    made.append(content);
  }

  function list() {
    body.replaceChildren();
    const several = new Set(tracks.map((track) => track.agent)).size < tracks.length;
    tracks.forEach((track, place) => {
      const row = body.insertRow();
      row.dataset.track = String(place);
      const label = document.createElement("label");
      const box = document.createElement("input");
      box.type = "checkbox";
      box.checked = chosen.has(track.run);
      box.addEventListener("change", () => {
        keepEnd(() => (box.checked ? chosen.add(track.run) : chosen.delete(track.run)));
      });
      const name = world.agents[track.agent].label + (several ? `, seed ${track.seed}` : "");
      label.append(box, key(track), name);
      cell(row, "text", label);
      cell(row, "text", track.outcome || "unknown");
      cell(row, "number", track.end.toFixed(1));
      cell(row, "number", "");
    });
  }

  function pick(which) {
    chosen.clear();
    const agents = new Set();
    for (const track of tracks) {
      // "few": choose one seed of each of the six best-ranked agents.
      if (which === "few" && (agents.size >= 6 || agents.has(track.agent))) continue;
      if (which === "none") continue;
      agents.add(track.agent);
      chosen.add(track.run);
    }
  }

  function choose(index) {
    episode = world.episodes[index];
    tracks = episode.tracks.map((track) => unpack(track, episode.waypoint));
    if (!tracks.some((track) => chosen.has(track.run))) pick("few");
    list();
    const [x, y, z] = episode.waypoint.map((v) => v.toFixed(1).replace("-", "−"));
    canvas.setAttribute("aria-label", `Paths of episode ${episode.episode}; ${world.goal} at east ${x} m, north ${y} m, up ${z} m`);
    setTime(longest());
    fit();
  }

  // Play the episode over time.
  let playing = false;
  function setPlaying(on) {
    playing = on;
    play.textContent = on ? "Pause" : "Play";
    play.setAttribute("aria-pressed", String(on));
    if (!on) return;
    if (time >= longest()) setTime(0);
    let before = performance.now();
    const step = (now) => {
      if (!playing) return;
      setTime(time + ((now - before) / 1000) * (longest() / PLAY_SECONDS));
      before = now;
      if (time >= longest()) setPlaying(false);
      else requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  // Mouse and touch: one pointer turns the view; with Shift or another button it moves the view; two pointers zoom and move.
  const pointers = new Map();
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
  });
  canvas.addEventListener("pointermove", (event) => {
    const held = pointers.get(event.pointerId);
    if (!held) return;
    const [dx, dy] = [event.clientX - held.x, event.clientY - held.y];
    const size = [canvas.clientWidth, canvas.clientHeight];
    if (pointers.size === 2) {
      const other = [...pointers].find(([id]) => id !== event.pointerId)[1];
      const before = Math.hypot(held.x - other.x, held.y - other.y);
      const after = Math.hypot(event.clientX - other.x, event.clientY - other.y);
      if (before > 1) camera.zoom(after / before);
      camera.pan(dx / 2, dy / 2, ...size);
    } else if (event.shiftKey || event.buttons > 1) camera.pan(dx, dy, ...size);
    else camera.turn(-dx * 0.008, dy * 0.008);
    Object.assign(held, { x: event.clientX, y: event.clientY });
    redraw();
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (event) => pointers.delete(event.pointerId));
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    // Zoom only after a click on the view, so that the wheel can scroll the page past the view.
    if (document.activeElement !== canvas) return;
    event.preventDefault();
    camera.zoom(Math.exp(-event.deltaY * 0.0015));
    redraw();
  }, { passive: false });

  canvas.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    const arrow = arrows[event.key];
    if (arrow && event.shiftKey) camera.pan(-24 * arrow[0], -24 * arrow[1], canvas.clientWidth, canvas.clientHeight);
    else if (arrow) camera.turn(-0.09 * arrow[0], 0.09 * arrow[1]);
    else if (event.key === "+" || event.key === "=") camera.zoom(1.15);
    else if (event.key === "-") camera.zoom(1 / 1.15);
    else if (event.key === " ") setPlaying(!playing);
    else if (event.key === "0") {
      camera.turnTo("free");
      fit();
    } else return;
    event.preventDefault();
    redraw();
  });

  for (const button of document.querySelectorAll("[data-view]")) {
    button.addEventListener("click", () => {
      camera.turnTo(button.dataset.view);
      fit();
    });
  }
  for (const button of document.querySelectorAll("[data-zoom]")) {
    button.addEventListener("click", () => {
      camera.zoom(Number(button.dataset.zoom));
      redraw();
    });
  }
  for (const button of document.querySelectorAll("[data-pick]")) {
    button.addEventListener("click", () => {
      keepEnd(() => pick(button.dataset.pick));
      list();
    });
  }
  picker.addEventListener("change", () => {
    setPlaying(false);
    choose(Number(picker.value));
  });
  play.addEventListener("click", () => setPlaying(!playing));
  clock.addEventListener("input", () => {
    setPlaying(false);
    setTime((Number(clock.value) / 1000) * longest());
  });
  const scrub = (event) => {
    if (event.type === "pointermove" && !event.buttons) return;
    setPlaying(false);
    setTime(toTime(event.clientX - plot.getBoundingClientRect().left));
  };
  plot.addEventListener("pointerdown", scrub);
  plot.addEventListener("pointermove", scrub);

  for (const { name, label } of SIGNALS) {
    const has = ["distance", "up", "east", "north"].includes(name) || (name === "separation" && world.team)
      || world.episodes.some((e) => e.tracks.some((track) => track.signals?.[name]));
    if (has) signals.add(new Option(label, name));
  }
  signals.addEventListener("change", () => {
    plot.setAttribute("aria-label", `${signals.selectedOptions[0].text} over time`);
    redraw();
  });

  world.episodes.forEach((entry, index) => {
    const reached = entry.tracks.filter((track) => track.outcome === "success").length;
    picker.add(new Option(`${entry.episode}: ${reached} of ${entry.tracks.length} ${world.goal === "waypoint" ? "reach it" : "succeed"}`, String(index)));
  });
  if (world.agents.length > 6) document.querySelector('[data-pick="few"]').textContent = "First six agents";
  by("viewer").hidden = false;
  choose(0);
  new ResizeObserver(redraw).observe(canvas);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
})();
