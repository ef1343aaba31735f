// Functions that all canvases use: canvas size, the page's colours, line styles.
const Pen = (() => {
  "use strict";
  const DASHES = { solid: [], dashed: [7, 4], dashdot: [8, 3, 2, 3], dotted: [2, 3] };
  const COLOURS = ["ink", "soft", "rule", "raised", "water"];

  /** Return the page's current colours (light or dark mode). */
  function palette() {
    const style = getComputedStyle(document.documentElement);
    return Object.fromEntries(COLOURS.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
  }

  function luminance(hex) {
    const parts = [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16) / 255);
    const linear = parts.map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4));
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2];
  }

  /** Return the contrast ratio of two colours (WCAG 2). */
  function contrast(a, b) {
    const [low, high] = [luminance(a), luminance(b)].sort((x, y) => x - y);
    return (high + 0.05) / (low + 0.05);
  }

  /** Set a canvas's resolution from its size on the page and the screen's pixel ratio, and clear the canvas. */
  function prepare(canvas) {
    const scale = Math.min(3, window.devicePixelRatio || 1);
    const [width, height] = [canvas.clientWidth || 600, canvas.clientHeight || 300];
    const [w, h] = [Math.round(width * scale), Math.round(height * scale)];
    if (canvas.width !== w) canvas.width = w;
    if (canvas.height !== h) canvas.height = h;
    const context = canvas.getContext("2d");
    context.setTransform(scale, 0, 0, scale, 0, 0);
    context.clearRect(0, 0, width, height);
    context.lineJoin = context.lineCap = "round";
    context.font = '12px system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif';
    return { context, width, height };
  }

  /** Draw a wider line in the page's soft colour below a line with low contrast, such as black in dark mode. */
  function halo(context, colours, width, draw) {
    context.strokeStyle = colours.soft;
    context.lineWidth = width;
    draw();
  }

  const text = (value) => String(value).replace("-", "−");

  return { DASHES, palette, contrast, prepare, halo, text };
})();
