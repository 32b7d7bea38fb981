/** Colours of states and curves, in turn: apart for colour-blind people, too. */

/** Light enough for dark words. */
export const FILLS = ["#9ecae9", "#ffbf79", "#88d27a", "#f2cf5b", "#d6a5c9", "#9fd4cf", "#ff9d98", "#c9c3bd"];

/** What a colour of the page's theme is now. */
export function ink(name: string): string {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

/** A canvas that fills its place, sharp on this screen, and empty; none while it has no place. */
export function penOf(canvas: HTMLCanvasElement | null): { pen: CanvasRenderingContext2D; width: number; height: number } | null {
  const pen = canvas?.getContext("2d");
  if (!canvas || !pen || canvas.clientWidth === 0) return null;
  const ratio = window.devicePixelRatio || 1;
  const { clientWidth: width, clientHeight: height } = canvas;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  return { pen, width, height };
}
