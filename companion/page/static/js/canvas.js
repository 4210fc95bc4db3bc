// A canvas that is as sharp as the screen.

/**
 * Fit a canvas's pixels to its size on the screen; return its context in CSS pixels, cleared, or null if nobody sees it.
 * @param {HTMLCanvasElement} canvas
 */
export function begin(canvas) {
  const { top, bottom } = canvas.getBoundingClientRect();
  const width = canvas.clientWidth;
  const height = canvas.clientHeight;
  if (bottom < 0 || top > innerHeight) return null;
  const context = canvas.getContext("2d");
  if (context === null || width === 0 || height === 0) return null;
  const scale = window.devicePixelRatio || 1;
  const [wide, high] = [Math.round(width * scale), Math.round(height * scale)];
  if (canvas.width !== wide || canvas.height !== high) {
    canvas.width = wide;
    canvas.height = high;
  }
  context.setTransform(scale, 0, 0, scale, 0, 0);
  context.clearRect(0, 0, width, height);
  context.lineCap = "round";
  context.lineJoin = "round";
  return { context, width, height };
}

/**
 * Draw a line through points on the screen; null lifts the pen.
 * @param {CanvasRenderingContext2D} context
 * @param {(number[] | null)[]} points
 * @param {string} stroke
 * @param {number} width
 * @param {number[]} [dash]
 */
export function line(context, points, stroke, width, dash = []) {
  context.beginPath();
  let down = false;
  for (const point of points) {
    if (point === null) down = false;
    else if (down) context.lineTo(point[0], point[1]);
    else {
      context.moveTo(point[0], point[1]);
      down = true;
    }
  }
  context.setLineDash(dash);
  context.strokeStyle = stroke;
  context.lineWidth = width;
  context.stroke();
  context.setLineDash([]);
}

/**
 * Write a text with a border in the background's colour, readable on any line.
 * @param {CanvasRenderingContext2D} context
 * @param {string} text
 * @param {number[]} at
 * @param {{fill: string, halo: string, size?: number, align?: CanvasTextAlign, bold?: boolean}} style
 */
export function label(context, text, at, style) {
  context.font = `${style.bold ? "700 " : ""}${style.size ?? 14}px system-ui, sans-serif`;
  context.textAlign = style.align ?? "left";
  context.textBaseline = "middle";
  context.lineWidth = 4;
  context.strokeStyle = style.halo;
  context.strokeText(text, at[0], at[1]);
  context.fillStyle = style.fill;
  context.fillText(text, at[0], at[1]);
}
