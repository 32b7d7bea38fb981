import { useEffect, useRef, useState } from "preact/hooks";
import { ink, penOf } from "./colours";
import { seconds, type Studio } from "./studio";

const SOUND_M_PER_US = 343e-6;
/** Echoes that are as long as this one are of nothing. */
const NOTHING_US = 25_000;
const MARGIN_PX = 18;
/** The shortest wall that a pointer draws, in metres. */
const LEAST_WALL_M = 0.1;

/** How the world is shown, and the wall that is being drawn. */
interface View {
  scale: number;
  left: number;
  bottom: number;
  drag: [number, number, number, number] | null;
}

/** The robot in its world, from above. */
export function Robot({ studio }: { studio: Studio }) {
  const words = studio.words;
  const canvas = useRef<HTMLCanvasElement>(null);
  const view = useRef<View>({ scale: 1, left: 0, bottom: 0, drag: null });
  const at = studio.robot();

  useEffect(() => {
    const paint = () => draw(canvas.current, studio, view.current);
    paint();
    const observer = new ResizeObserver(paint);
    if (canvas.current) observer.observe(canvas.current);
    return () => observer.disconnect();
  });

  /** Where in the world the pointer is, in metres. */
  const pointed = (event: PointerEvent): [number, number] => {
    const box = canvas.current!.getBoundingClientRect();
    const { scale, left, bottom } = view.current;
    return [(event.clientX - box.left - left) / scale, (bottom - (event.clientY - box.top)) / scale];
  };
  const [drag, setDrag] = useState<[number, number, number, number] | null>(null);
  view.current.drag = drag;
  const down = (event: PointerEvent) => {
    if (!studio.places || !canvas.current) return;
    const [x, y] = pointed(event);
    if (studio.places === "person") return studio.putPerson(x, y);
    canvas.current.setPointerCapture(event.pointerId);
    setDrag([x, y, x, y]);
  };
  const move = (event: PointerEvent) => {
    if (drag) setDrag([drag[0], drag[1], ...pointed(event)]);
  };
  const up = (event: PointerEvent) => {
    if (!drag) return;
    const [x, y] = pointed(event);
    setDrag(null);
    // A click alone is no wall.
    if (Math.hypot(x - drag[0], y - drag[1]) >= LEAST_WALL_M) studio.putWall(drag[0], drag[1], x, y);
  };

  const degrees = at ? String(Math.round((at[3] * 180) / Math.PI)) : "";
  const states = studio.run?.activeAt(studio.t_us).join(", ") ?? "";
  const label = at
    ? `${words.worldLabel}. ${words.robotAt(at[1].toFixed(1), at[2].toFixed(1), degrees, states)}`
    : words.worldLabel;
  const done = studio.interventionWords();
  const end = studio.run?.end;
  return (
    <section class={`panel robot ${studio.tab === "robot" ? "shown" : ""}`} aria-label={words.robot} id="robot">
      <header>
        <h2>{words.robot}</h2>
        <span class="facts">
          {at && at[4] !== null && at[5] !== null && <>{at[4].toFixed(1)} V · {words.touches(at[5])}</>}
          {at && at[4] === null && words.byOdometry}
          {end && <> · {end.distance_m.toFixed(1)} m{end.finished_us !== null && <> · {words.finished} {seconds(end.finished_us)}</>}
            {end.fault && <strong> · {words.fault}: {end.fault}</strong>}</>}
        </span>
      </header>
      <canvas ref={canvas} role="img" aria-label={label} class={studio.places ? "placing" : ""}
        onPointerDown={down} onPointerMove={move} onPointerUp={up} />
      {studio.run?.kind === "simulated" && (
        <div class="hands">
          {(["person", "wall"] as const).map((thing) => (
            <button aria-pressed={studio.places === thing} title={words.placeHelp[thing]}
              onClick={() => studio.set({ places: studio.places === thing ? null : thing })}>{words.place[thing]}</button>
          ))}
          <button title={words.personAheadHelp} onClick={() => studio.putPersonAhead()}>{words.personAhead}</button>
          <button title={words.wallAheadHelp} onClick={() => studio.putWallAhead()}>{words.wallAhead}</button>
          <select aria-label={words.breakPart} value="" onChange={(event) => {
            const [kind, which] = event.currentTarget.value.split(" ");
            event.currentTarget.value = "";
            if (kind === "sonar") studio.killSonar(Number(which));
            if (kind === "wheel") studio.stopWheel(which);
          }}>
            <option value="">{words.breakPart}</option>
            {[0, 1, 2, 3, 4, 5, 6, 7].map((sonar) => <option value={`sonar ${sonar}`}>{words.sonar(sonar)}</option>)}
            {["left", "right"].map((wheel) => <option value={`wheel ${wheel}`}>{words.wheel(wheel)}</option>)}
          </select>
          <button class="stop" title={words.stopHelp} onClick={() => studio.pressStop()}>{words.stop}</button>
          {done.length > 0 && <>
            <ul class="done" aria-label={words.done}>{done.map((text) => <li>{text}</li>)}</ul>
            <button title={words.clearHelp} onClick={() => studio.clearInterventions()}>{words.clear}</button>
          </>}
        </div>
      )}
    </section>
  );
}

function draw(canvas: HTMLCanvasElement | null, studio: Studio, view: View): void {
  const world = studio.world;
  const drawn = penOf(canvas);
  if (!drawn) return;
  const { pen, width, height } = drawn;
  if (!world) return;
  const [x0, y0, x1, y1] = world.bounds;
  const scale = Math.min((width - 2 * MARGIN_PX) / (x1 - x0), (height - 2 * MARGIN_PX) / (y1 - y0));
  const left = (width - scale * (x1 - x0)) / 2 - scale * x0;
  const bottom = height - (height - scale * (y1 - y0)) / 2 + scale * y0;
  Object.assign(view, { scale, left, bottom });
  const px = (x: number) => left + scale * x;
  const py = (y: number) => bottom - scale * y;
  const line = (points: number[][], close = false) => {
    pen.beginPath();
    points.forEach(([x, y], index) => (index === 0 ? pen.moveTo(px(x), py(y)) : pen.lineTo(px(x), py(y))));
    if (close) pen.closePath();
  };
  pen.lineCap = "round";
  pen.lineJoin = "round";

  world.rooms.forEach((room, index) => {
    line(room.outline, true);
    pen.fillStyle = ink(index % 2 ? "--room-b" : "--room-a");
    pen.fill();
    const [x, y] = [0, 1].map((axis) => {
      const all = room.outline.map((point) => point[axis]);
      return (Math.min(...all) + Math.max(...all)) / 2;
    });
    pen.fillStyle = ink("--room-name");
    pen.font = "600 13px system-ui, sans-serif";
    pen.textAlign = "center";
    pen.fillText(room.name, px(x), py(y));
  });
  for (const [ax, ay, bx, by, thick] of world.lines) {
    line([[ax, ay], [bx, by]]);
    pen.strokeStyle = ink("--floor-line");
    pen.lineWidth = Math.max(2, thick * scale);
    pen.stroke();
  }
  pen.strokeStyle = ink("--low");
  pen.lineWidth = 2;
  pen.setLineDash([5, 4]);
  for (const [ax, ay, bx, by] of world.low) {
    line([[ax, ay], [bx, by]]);
    pen.stroke();
  }
  pen.setLineDash([]);
  pen.strokeStyle = ink("--wall");
  pen.lineWidth = 3;
  for (const [ax, ay, bx, by] of [...world.walls, ...(studio.run?.wallsAt(studio.t_us) ?? []), ...(view.drag ? [view.drag] : [])]) {
    line([[ax, ay], [bx, by]]);
    pen.stroke();
  }

  const run = studio.run;
  const at = studio.robot() ?? [0, world.start[0], world.start[1], world.start[2], 0, 0, []];
  if (run) {
    const [way, here] = run.way(studio.t_us, world);
    pen.lineWidth = 1.5;
    pen.strokeStyle = ink("--way-ahead");
    line(way.slice(Math.max(0, here - 1)));
    pen.stroke();
    pen.lineWidth = 2.2;
    pen.strokeStyle = ink("--way");
    line([...way.slice(0, here), [at[1], at[2]]]);
    pen.stroke();
  }
  for (const [x, y, radius] of run?.peopleAt(studio.t_us) ?? []) {
    pen.beginPath();
    pen.arc(px(x), py(y), radius * scale, 0, 2 * Math.PI);
    pen.fillStyle = ink("--person");
    pen.fill();
    pen.strokeStyle = ink("--person-edge");
    pen.lineWidth = 2;
    pen.stroke();
  }
  const [, x, y, heading] = at;
  at[6].forEach((echo, index) => {
    if (echo === null || echo >= NOTHING_US) return;
    const direction = heading + (index * Math.PI) / 4;
    const reach = world.sonar_rim_m + (echo * SOUND_M_PER_US) / 2;
    const spread = 0.12;
    pen.beginPath();
    pen.moveTo(px(x + world.sonar_rim_m * Math.cos(direction)), py(y + world.sonar_rim_m * Math.sin(direction)));
    pen.lineTo(px(x + reach * Math.cos(direction - spread)), py(y + reach * Math.sin(direction - spread)));
    pen.lineTo(px(x + reach * Math.cos(direction + spread)), py(y + reach * Math.sin(direction + spread)));
    pen.closePath();
    pen.fillStyle = ink("--beam");
    pen.fill();
  });
  const radius = Math.max(5, world.radius_m * scale);
  pen.beginPath();
  pen.arc(px(x), py(y), radius, 0, 2 * Math.PI);
  pen.fillStyle = ink("--robot");
  pen.fill();
  pen.strokeStyle = ink("--robot-edge");
  pen.lineWidth = 2;
  pen.stroke();
  pen.beginPath();
  pen.moveTo(px(x), py(y));
  pen.lineTo(px(x) + radius * Math.cos(heading), py(y) - radius * Math.sin(heading));
  pen.lineWidth = 3;
  pen.stroke();
}
