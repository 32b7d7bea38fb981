/**
 * A picture that is dragged and zoomed. While it moves, it is a layer that the compositor moves and scales: a frame
 * takes neither layout nor painting, however much there is in the picture. When it is still, it is laid out where it
 * came to, so that letters are sharp, and scroll bars, focus and search find it there.
 */

const LEAST = 0.15;
const MOST = 3;
/** What is still for so long is laid out. */
const STILL_MS = 160;
/** Around the picture in its box, as its style says. */
const PADDING_PX = 8;
/** So far the pointer goes before the picture is dragged, and not clicked. */
const CLICK_PX = 4;

/** How the picture is seen: how large, and which place of it is at the corner. */
interface View {
  zoom: number;
  left: number;
  top: number;
}

/** A picture that moves: how it is laid out, how it is seen, and its measures, which stay meanwhile. */
interface Moving {
  laid: View;
  seen: View;
  /** Of the picture, and of its box. */
  width: number;
  height: number;
  box_width: number;
  box_height: number;
}

export class Sheet {
  /** Whether the pointer has dragged the picture since it was pressed. */
  isDragged = false;
  /** How large it is laid out; nothing before there is a picture. */
  private zoom = 0;
  private moving: Moving | null = null;
  /** Where the pointer was pressed, and how the picture was seen when it began to be dragged. */
  private held: { x: number; y: number; from: View | null } | null = null;
  private timer = 0;

  /** The box that scrolls, what is in it, and what lies above it while it is dragged. */
  constructor(private box: HTMLElement, private content: HTMLElement, private shield: HTMLElement) {
    box.addEventListener("pointerdown", (event) => this.press(event));
    box.addEventListener("pointermove", (event) => this.drag(event));
    box.addEventListener("pointerup", () => this.release());
    box.addEventListener("pointercancel", () => this.release());
    box.addEventListener("wheel", (event) => {
      if (!event.ctrlKey) return;
      event.preventDefault();
      const { left, top } = box.getBoundingClientRect();
      this.zoomBy(event.deltaY < 0 ? 1.1 : 1 / 1.1, event.clientX - left, event.clientY - top);
    }, { passive: false });
  }

  private get picture(): SVGSVGElement | null {
    return this.content.querySelector("svg");
  }

  /** Another picture of the same thing: it is as large as the one before, or fits. */
  changed(): void {
    this.settle();
    if (this.zoom === 0) this.fit();
    else this.lay(this.zoom);
  }

  /** The next picture is of something else. */
  forget(): void {
    this.settle();
    this.zoom = 0;
  }

  /** As wide as its box. */
  fit(): void {
    this.settle();
    const picture = this.picture;
    // A part that is not shown has no width.
    if (!picture || !this.box.clientWidth) return;
    const width = this.box.clientWidth - 2 * PADDING_PX - 2;
    this.lay(Math.min(1.2, Math.max(LEAST, width / picture.viewBox.baseVal.width)));
  }

  /** Gives it a size, where it could have none before. */
  show(): void {
    if (this.zoom === 0) this.fit();
  }

  /** Makes it larger or smaller; a place of the box stays where it is: its middle, if none is named. */
  zoomBy(factor: number, x?: number, y?: number): void {
    const moving = this.begin();
    if (!moving) return;
    const { seen } = moving;
    const [middle, centre] = [x ?? moving.box_width / 2, y ?? moving.box_height / 2];
    const zoom = Math.min(MOST, Math.max(LEAST, seen.zoom * factor));
    const grown = zoom / seen.zoom;
    this.move({
      zoom,
      left: (seen.left + middle - PADDING_PX) * grown - middle + PADDING_PX,
      top: (seen.top + centre - PADDING_PX) * grown - centre + PADDING_PX,
    });
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.settle(), STILL_MS);
  }

  private press(event: PointerEvent): void {
    this.isDragged = false;
    if (event.pointerType !== "mouse" || event.button !== 0) return;
    this.settle();
    this.held = { x: event.clientX, y: event.clientY, from: null };
  }

  private drag(event: PointerEvent): void {
    const { held } = this;
    if (!held || !(event.buttons & 1)) return;
    const [x, y] = [event.clientX - held.x, event.clientY - held.y];
    if (!held.from) {
      if (Math.hypot(x, y) <= CLICK_PX) return;
      const moving = this.begin();
      if (!moving) return;
      held.from = moving.seen;
      this.isDragged = true;
      clearTimeout(this.timer);
      this.box.setPointerCapture(event.pointerId);
      // Nothing below the pointer is looked for while all of it moves.
      this.shield.hidden = false;
    }
    this.move({ zoom: held.from.zoom, left: held.from.left - x, top: held.from.top - y });
  }

  private release(): void {
    this.held = null;
    if (this.shield.hidden) return;
    this.shield.hidden = true;
    this.settle();
  }

  /** Begins to move, if it does not yet. */
  private begin(): Moving | null {
    const picture = this.picture;
    if (this.moving || !picture || this.zoom === 0) return this.moving;
    const { width, height } = picture.viewBox.baseVal;
    const laid = { zoom: this.zoom, left: this.box.scrollLeft, top: this.box.scrollTop };
    this.moving = { laid, seen: laid, width, height, box_width: this.box.clientWidth, box_height: this.box.clientHeight };
    return this.moving;
  }

  /** Has the compositor show it so, as far as there is something to see. */
  private move(view: View): void {
    const { moving } = this;
    if (!moving) return;
    const within = (place: number, size: number, room: number) => (
      Math.min(Math.max(0, place), Math.max(0, size * view.zoom + 2 * PADDING_PX - room)));
    const left = within(view.left, moving.width, moving.box_width);
    const top = within(view.top, moving.height, moving.box_height);
    const { laid } = moving;
    moving.seen = { zoom: view.zoom, left, top };
    this.content.style.transform = `translate(${laid.left - left}px, ${laid.top - top}px) scale(${view.zoom / laid.zoom})`;
  }

  /** Lays it out as it is seen. */
  private settle(): void {
    clearTimeout(this.timer);
    const { moving } = this;
    if (!moving) return;
    this.moving = null;
    if (this.held) this.held.from = null;
    this.content.style.transform = "";
    const { zoom, left, top } = moving.seen;
    if (zoom !== this.zoom) this.lay(zoom);
    this.box.scrollTo({ left, top, behavior: "instant" });
  }

  private lay(zoom: number): void {
    const picture = this.picture;
    if (!picture) return;
    this.zoom = zoom;
    const { width, height } = picture.viewBox.baseVal;
    picture.style.width = `${width * zoom}px`;
    picture.style.height = `${height * zoom}px`;
  }
}
