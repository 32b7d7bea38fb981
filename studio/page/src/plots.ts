/** Curves and slots over time, drawn below the states. */
import { FILLS, ink } from "./colours";
import { behind } from "./run";
import { seconds, type Studio } from "./studio";

export const NAMES_PX = 128;
/** Height of a curve, and of a slot. */
export const CURVE_PX = 56;
export const SLOT_PX = 20;
const RIGHT_PX = 8;

type Place = { pen: CanvasRenderingContext2D; width: number; top: number };

/** The name of a row, at its left. */
export function drawName({ pen, top }: Place, name: string, height: number): void {
  pen.save();
  pen.beginPath();
  pen.rect(0, top, NAMES_PX - 6, height);
  pen.clip();
  pen.fillStyle = ink("--ink");
  pen.textAlign = "right";
  pen.textBaseline = "middle";
  pen.fillText(name, NAMES_PX - 8, top + height / 2);
  pen.restore();
}

/** A number as short as it can be read. */
export function short(value: number): string {
  return Number(value.toPrecision(3)).toString();
}

/** The curve of a number: of those in one column of the picture the least and the greatest. */
export function drawCurve(place: Place, studio: Studio, name: string, index: number, x: (t_us: number) => number): void {
  const { pen, top, width } = place;
  const points = studio.run?.knownCurve(name) ?? [];
  const unit = studio.curves.find(([known]) => known === name)?.[1] ?? "";
  const [net, ...field] = name.split(" ");
  pen.font = "12px system-ui, sans-serif";
  drawName({ ...place, top: top + 4 }, net.slice(net.lastIndexOf("/") + 1), 16);
  drawName({ ...place, top: top + 20 }, field.join(" "), 16);
  const here = behind(points, studio.t_us, (it) => it[0]) - 1;
  if (here >= 0) drawName({ ...place, top: top + 36 }, `${short(points[here][1])} ${unit}`, 16);
  pen.fillStyle = ink("--head");
  pen.fillRect(NAMES_PX, top + 2, width - NAMES_PX - RIGHT_PX, CURVE_PX - 4);
  if (points.length === 0) return;
  let [least, greatest] = [Infinity, -Infinity];
  for (const [, value] of points) {
    least = Math.min(least, value);
    greatest = Math.max(greatest, value);
  }
  const room = CURVE_PX - 12;
  const y = (value: number) => top + 6 + room * (greatest === least ? 0.5 : (greatest - value) / (greatest - least));
  if (least < 0 && greatest > 0) {
    pen.fillStyle = ink("--edge");
    pen.fillRect(NAMES_PX, y(0), width - NAMES_PX - RIGHT_PX, 1);
  }
  for (const it of studio.breakpoints.values()) {
    if (it.kind !== "value" || it.curve !== name || it.limit < least || it.limit > greatest) continue;
    pen.fillStyle = ink("--bad");
    pen.fillRect(NAMES_PX, y(it.limit), width - NAMES_PX - RIGHT_PX, 1);
  }
  pen.beginPath();
  let column = NaN;
  let [low, high, last] = [0, 0, 0];
  const end = () => {
    if (Number.isNaN(column)) return;
    pen.lineTo(column, y(low));
    pen.lineTo(column, y(high));
    pen.lineTo(column, y(last));
  };
  for (const [t_us, value] of points) {
    const at = Math.round(x(t_us));
    if (at !== column) {
      end();
      [column, low, high] = [at, value, value];
    }
    [low, high, last] = [Math.min(low, value), Math.max(high, value), value];
  }
  end();
  pen.strokeStyle = ink(`--curve-${index % 4}`);
  pen.lineWidth = 1.4;
  pen.stroke();
  pen.fillStyle = ink("--soft");
  pen.font = "10.5px system-ui, sans-serif";
  pen.textAlign = "right";
  pen.fillText(`${short(greatest)} ${unit}`, width - RIGHT_PX - 3, top + 9);
  pen.fillText(short(least), width - RIGHT_PX - 3, top + CURVE_PX - 9);
}

/** Where the activations of slots are around the moment: nominal starts, durations, what is executed in each. */
export function drawSlots(place: Place, studio: Studio): void {
  const { pen, width } = place;
  const [slots, run] = [studio.slots, studio.run];
  if (!slots || !run) return;
  const longest = Math.max(...slots.slots.map((slot) => slot.period_us));
  const span = Math.min(4 * longest, 400_000);
  const from = studio.t_us - span / 2;
  const x = (t_us: number) => NAMES_PX + ((width - NAMES_PX - RIGHT_PX) * (t_us - from)) / span;
  // The first macro step is the first activation of the interpreter's slot.
  const origin = slots.start_us - (slots.slots.find((slot) => slot.interpreter)?.start_us ?? 0);
  let top = place.top;
  pen.font = "12px system-ui, sans-serif";
  for (const slot of slots.slots) {
    const counted = run.connected?.slots.find((it) => it.number === slot.number);
    const told = counted ? ` ${Math.round(counted.load * 100)} % · ${short(counted.delay_us)} µs` : "";
    drawName({ ...place, top }, `${studio.words.slot} ${slot.number}${told}`, SLOT_PX);
    pen.save();
    pen.beginPath();
    pen.rect(NAMES_PX, top, width - NAMES_PX - RIGHT_PX, SLOT_PX);
    pen.clip();
    const first = Math.max(0, Math.floor((from - origin - slot.start_us) / slot.period_us));
    for (let number = first; ; number++) {
      const start = origin + slot.start_us + number * slot.period_us;
      if (start > from + span) break;
      const active = new Set(run.activeAt(start));
      const tasks = slot.tasks.filter((path) => active.has(path)).map((path) => path.slice(path.lastIndexOf("/") + 1));
      if (slot.interpreter) tasks.unshift(studio.words.interpreter);
      const [left, right] = [x(start), x(start + slot.duration_us)];
      pen.fillStyle = tasks.length === 0 ? ink("--edge") : FILLS[slots.slots.indexOf(slot) % FILLS.length];
      pen.fillRect(left, top + 2, Math.max(1, right - left), SLOT_PX - 4);
      if (right - left > 26) {
        pen.save();
        pen.beginPath();
        pen.rect(left, top, right - left - 2, SLOT_PX);
        pen.clip();
        pen.fillStyle = "#1a1a1a";
        pen.textAlign = "left";
        pen.fillText(tasks.join(", "), left + 3, top + SLOT_PX / 2);
        pen.restore();
      }
    }
    pen.restore();
    top += SLOT_PX;
  }
  pen.fillStyle = ink("--ink");
  pen.textAlign = "center";
  const each = [5_000, 10_000, 20_000, 50_000, 100_000].find((step) => span / step <= 10) ?? 100_000;
  for (let t_us = Math.ceil(from / each) * each; t_us < from + span; t_us += each) {
    if (t_us < 0) continue;
    pen.fillRect(x(t_us), top, 1, 4);
    pen.fillText(`${(t_us / 1e6).toFixed(3)} s`, x(t_us), top + 12);
  }
  pen.fillStyle = ink("--accent");
  pen.fillRect(x(studio.t_us) - 1, place.top, 2, top - place.top);
}

/** What is drawn of slots, in words. */
export function slotWords(studio: Studio): string {
  return (studio.slots?.slots ?? []).map((slot) => (
    `${studio.words.slot} ${slot.number}: ${seconds(slot.period_us)}, ${slot.tasks.join(", ")}`
  )).join("; ");
}
