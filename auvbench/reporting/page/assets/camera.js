// Camera of the 3-D view: turn, move, zoom, and project metres to pixels. World frame ENU: x east, y north, z up.
const Camera = (() => {
  "use strict";
  const FOCAL = 1.6;
  const VIEWS = {
    free: { azimuth: -1.05, elevation: 0.38, flat: false },
    top: { azimuth: -Math.PI / 2, elevation: Math.PI / 2, flat: true },
    south: { azimuth: -Math.PI / 2, elevation: 0, flat: true },
    east: { azimuth: 0, elevation: 0, flat: true },
  };

  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

  class Camera {
    constructor() {
      this.distance = 100;
      this.target = [0, 0, -30];
      this.turnTo("free");
    }
    turnTo(view) {
      Object.assign(this, VIEWS[view]);
    }
    turn(azimuth, elevation) {
      this.flat = false;
      this.azimuth += azimuth;
      this.elevation = Math.max(-1.2, Math.min(Math.PI / 2, this.elevation + elevation));
    }
    zoom(factor) {
      this.distance = Math.max(2, Math.min(5000, this.distance / factor));
    }
    axes() {
      const [ca, sa] = [Math.cos(this.azimuth), Math.sin(this.azimuth)];
      const [ce, se] = [Math.cos(this.elevation), Math.sin(this.elevation)];
      return { right: [-sa, ca, 0], up: [-se * ca, -se * sa, ce], back: [ce * ca, ce * sa, se] };
    }
    /** Return a function that projects a point (m) to [x, y, pixels per metre]; null for a point behind the camera. */
    projector(width, height) {
      const { right, up, back } = this.axes();
      const focal = FOCAL * Math.min(width, height);
      const { target, distance, flat } = this;
      return (p) => {
        const rel = [p[0] - target[0], p[1] - target[1], p[2] - target[2]];
        const depth = flat ? distance : distance - dot(rel, back);
        if (depth < 0.3) return null;
        const scale = focal / depth;
        return [width / 2 + dot(rel, right) * scale, height / 2 - dot(rel, up) * scale, scale];
      };
    }
    /** Move the camera by pixels in the plane of the picture. */
    pan(dx, dy, width, height) {
      const { right, up } = this.axes();
      const metres = this.distance / (FOCAL * Math.min(width, height));
      this.target = this.target.map((v, i) => v - right[i] * dx * metres + up[i] * dy * metres);
    }
    /** Centre the box in the picture, and zoom until the box fills the picture except a margin for labels. */
    fit(box, width, height) {
      this.target = box.low.map((low, i) => (low + box.high[i]) / 2);
      const size = Math.hypot(...box.low.map((low, i) => box.high[i] - low));
      this.distance = 2 * FOCAL * size;
      const room = [Math.max(60, width - 150), Math.max(60, height - 100)];
      for (let round = 0; round < 6; round++) {
        const project = this.projector(width, height);
        const seen = corners(box).map(project).filter(Boolean);
        const [xs, ys] = [seen.map((p) => p[0]), seen.map((p) => p[1])];
        const [x0, x1, y0, y1] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
        this.pan(width / 2 - (x0 + x1) / 2, height / 2 - (y0 + y1) / 2, width, height);
        this.distance *= Math.max((x1 - x0) / room[0], (y1 - y0) / room[1]);
      }
    }
  }

  function corners({ low, high }) {
    const found = [];
    for (const x of [low[0], high[0]]) for (const y of [low[1], high[1]]) for (const z of [low[2], high[2]]) found.push([x, y, z]);
    return found;
  }

  return Camera;
})();
