import { useEffect, useRef, useState } from "preact/hooks";
import { Sheet } from "./sheet";
import type { Studio } from "./studio";

const SVG = "http://www.w3.org/2000/svg";
/** Size of the mark that folds a superstate, with the room around it that takes a click. */
const FOLD_PX = 9;
const FOLD_ROOM_PX = 4;

/** A mark in the corner of a superstate, which folds and opens it. */
function foldMark(corner: SVGRectElement, isOpen: boolean, help: string): SVGGElement {
  const [x, y, width] = ["x", "y", "width"].map((name) => Number(corner.getAttribute(name)));
  const mark = document.createElementNS(SVG, "g");
  mark.setAttribute("class", "fold");
  const [left, top] = [x + width - FOLD_PX - 5, y + 5];
  const add = (name: string, attributes: Record<string, string | number>) => {
    const part = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) part.setAttribute(key, String(value));
    mark.append(part);
  };
  const room = FOLD_PX + 2 * FOLD_ROOM_PX;
  add("rect", { class: "room", x: left - FOLD_ROOM_PX, y: top - FOLD_ROOM_PX, width: room, height: room });
  add("rect", { x: left, y: top, width: FOLD_PX, height: FOLD_PX, rx: 2 });
  const [middle, half] = [FOLD_PX / 2, FOLD_PX / 2 - 2];
  const level = `M${left + middle - half} ${top + middle}h${2 * half}`;
  add("path", { d: isOpen ? level : `${level}m${-half} ${-half}v${2 * half}` });
  const title = document.createElementNS(SVG, "title");
  title.textContent = help;
  mark.append(title);
  return mark;
}

/** The state diagram: the engine's own picture, with what is current lit. */
export function Diagram({ studio }: { studio: Studio }) {
  const words = studio.words;
  const box = useRef<HTMLDivElement>(null);
  const sheet = useRef<HTMLDivElement>(null);
  const shield = useRef<HTMLDivElement>(null);
  const moves = useRef<Sheet>(null);
  const [search, setSearch] = useState("");
  const [found, setFound] = useState(0);
  const at = useRef(-1);
  const svg = studio.drawn?.svg ?? null;

  useEffect(() => { moves.current = new Sheet(box.current!, sheet.current!, shield.current!); }, []);

  /** The state that was folded or opened, and where it stood: there it stays. */
  const folded = useRef<{ path: string; x: number; y: number } | null>(null);
  const stateOf = (path: string) => sheet.current?.querySelector<SVGGElement>(`g.state[data-path="${CSS.escape(path)}"]`);
  const fold = (chosen: SVGGElement) => {
    const path = chosen.dataset.path ?? "";
    const { x, y } = chosen.getBoundingClientRect();
    folded.current = { path, x, y };
    void studio.fold(path);
  };

  useEffect(() => {
    if (!sheet.current) return;
    // Who goes through it by keyboard stays at the same part of the next picture.
    const focused = sheet.current.contains(document.activeElement) ? (document.activeElement as SVGGElement) : null;
    const { path: focusedPath, to: focusedTo } = focused?.dataset ?? {};
    sheet.current.innerHTML = svg ?? "";
    for (const part of sheet.current.querySelectorAll<SVGGElement>("g.transition")) {
      part.setAttribute("tabindex", "0");
      part.setAttribute("role", "button");
      const shown = [...part.querySelectorAll("text")].map((text) => text.textContent).join(" ");
      part.setAttribute("aria-label", `${shown}, ${part.dataset.path} → ${part.dataset.to}`);
    }
    for (const part of sheet.current.querySelectorAll<SVGGElement>("g.state")) {
      const path = part.dataset.path ?? "";
      part.setAttribute("tabindex", "0");
      part.setAttribute("role", "button");
      const shown = [...part.querySelectorAll("text")].map((text) => text.textContent).join(" ");
      part.setAttribute("aria-label", `${shown}, ${path}`);
      const first = part.querySelector("rect");
      if (!first) continue;
      const isOpen = part.classList.contains("open");
      if (isOpen || part.classList.contains("folded")) {
        part.setAttribute("aria-expanded", String(isOpen));
        part.append(foldMark(first, isOpen, words.fold));
      }
      const circle = document.createElementNS(SVG, "circle");
      circle.setAttribute("class", "breakpoint");
      circle.setAttribute("cx", String(Number(first.getAttribute("x")) + 7));
      circle.setAttribute("cy", String(Number(first.getAttribute("y")) + 7));
      circle.setAttribute("r", "4");
      part.append(circle);
    }
    const picture = sheet.current.querySelector("svg");
    picture?.setAttribute("role", "group");
    picture?.setAttribute("aria-label", words.diagramLabel);
    if (focusedPath !== undefined) {
      const parts = [...sheet.current.querySelectorAll<SVGGElement>("g[tabindex]")];
      const same = parts.find((part) => part.dataset.path === focusedPath && part.dataset.to === focusedTo);
      same?.focus({ preventScroll: true });
    }
  }, [svg, studio.language]);

  // Another file has another picture.
  useEffect(() => moves.current?.forget(), [studio.path]);
  useEffect(() => {
    moves.current?.changed();
    const stood = folded.current;
    const now = stood && stateOf(stood.path)?.getBoundingClientRect();
    if (now) box.current?.scrollBy({ left: now.x - stood.x, top: now.y - stood.y, behavior: "instant" });
    folded.current = null;
  }, [svg]);
  useEffect(() => moves.current?.show(), [studio.tab]);

  const active = studio.run?.activeAt(studio.t_us) ?? [];
  const key = active.join(" ");
  const breaks = [...studio.breakpoints.keys()].join(" ");
  useEffect(() => {
    const lit = new Set(active);
    for (const part of sheet.current?.querySelectorAll<SVGGElement>("g[data-path]") ?? []) {
      const path = part.dataset.path ?? "";
      part.classList.toggle("lit", !part.classList.contains("transition") && lit.has(path));
      const to = part.dataset.to ?? "";
      const breakpoint = part.classList.contains("transition")
        ? { kind: "transition", from: path, to } as const : { kind: "state", path } as const;
      part.classList.toggle("breaks", studio.hasBreakpoint(breakpoint));
      const isFound = search !== "" && path.toLowerCase().includes(search.toLowerCase());
      part.classList.toggle("found", isFound && part.classList.contains("state"));
    }
    setFound(search === "" ? 0 : sheet.current?.querySelectorAll("g.state.found").length ?? 0);
  }, [svg, key, breaks, search]);
  useEffect(() => { at.current = -1; }, [svg, search]);

  // The transitions that were taken in this macro step.
  const taken = (studio.choices?.micro_steps ?? [])
    .flatMap((micro) => micro.choices.filter((it) => it.taken).map((it) => `${it.from} ${it.to}`)).join("\n");
  useEffect(() => {
    const all = new Set(taken.split("\n"));
    for (const part of sheet.current?.querySelectorAll<SVGGElement>("g.transition") ?? []) {
      part.classList.toggle("taken", all.has(`${part.dataset.path} ${part.dataset.to}`));
    }
  }, [svg, taken]);

  // The state that the cursor is in.
  useEffect(() => {
    const index = studio.drawn?.files?.indexOf(studio.path) ?? -1;
    const before = new TextEncoder().encode(studio.text(studio.path).slice(0, studio.cursor)).length;
    let nearest: SVGGElement | null = null;
    let start = -1;
    const parts = sheet.current?.querySelectorAll<SVGGElement>("g[data-start]") ?? [];
    for (const part of parts) {
      part.classList.remove("cursor");
      const at = Number(part.dataset.start);
      if (Number(part.dataset.file) === index && at <= before && at > start) [nearest, start] = [part, at];
    }
    nearest?.classList.add("cursor");
  }, [svg, studio.cursor]);

  /** Goes to the next state that is found, or the one before. */
  const next = (by: number) => {
    const all = [...(sheet.current?.querySelectorAll<SVGGElement>("g.state.found") ?? [])];
    if (all.length === 0) return;
    at.current = (at.current + by + all.length) % all.length;
    const chosen = all[at.current];
    chosen.scrollIntoView({ block: "center", inline: "center" });
    sheet.current?.querySelector("g.here")?.classList.remove("here");
    chosen.classList.add("here");
  };
  const part = (event: Event) => (event.target as Element).closest<SVGGElement>("g[data-start]");
  const activate = async (event: Event) => {
    if (event.type === "click" && moves.current?.isDragged) return;
    const chosen = part(event);
    if (!chosen) return;
    if (event.type === "click" && (event.target as Element).closest(".fold")) {
      fold(chosen);
      return;
    }
    if ((event.target as Element).classList.contains("breakpoint")) {
      studio.toggleBreakpoint({ kind: "state", path: chosen.dataset.path ?? "" });
      return;
    }
    if (chosen.classList.contains("transition") && studio.run) studio.why(chosen.dataset.path ?? "", chosen.dataset.to ?? "");
    const file = studio.drawn?.files?.[Number(chosen.dataset.file)];
    if (file && file !== studio.path) await studio.openFile(file);
    studio.set({ tab: "text" });
    studio.editor.goTo(Number(chosen.dataset.start));
  };

  return (
    <section class={`panel diagram ${studio.tab === "diagram" ? "shown" : ""}`} aria-label={words.diagram} id="diagram">
      <header>
        <h2>{words.diagram}</h2>
        <input type="search" value={search} placeholder={words.search} aria-label={words.search}
          onInput={(event) => setSearch(event.currentTarget.value)}
          onKeyDown={(event) => { if (event.key === "Enter") next(event.shiftKey ? -1 : 1); }} />
        {search && <span class="facts" role="status">{words.found(found)}</span>}
        <select aria-label={words.depth} title={words.depth} value={String(studio.depth)} onChange={(event) => {
          const chosen = event.currentTarget.value;
          studio.showDepth(chosen === "null" ? null : Number(chosen));
        }}>
          {[0, 1, 2, null].map((depth) => <option value={String(depth)} selected={depth === studio.depth}>{words.depthOf(depth)}</option>)}
        </select>
        <label><input type="checkbox" checked={studio.showsData}
          onChange={() => { studio.showsData = !studio.showsData; void studio.draw(); }} /> {words.data}</label>
        <span class="group">
          <button onClick={() => moves.current?.zoomBy(1 / 1.25)} aria-label={words.zoomOut} title={words.zoomOut}>−</button>
          <button onClick={() => moves.current?.fit()} title={words.fit}>{words.fit}</button>
          <button onClick={() => moves.current?.zoomBy(1.25)} aria-label={words.zoomIn} title={words.zoomIn}>+</button>
        </span>
      </header>
      {studio.isStale && <p class="note" role="status">{svg ? words.stays : studio.drawn?.reason ?? words.noDiagram}</p>}
      <div class={`sheet ${studio.isStale ? "stale" : ""}`} ref={box} tabIndex={0} role="region" aria-label={words.diagramLabel}
        onKeyDown={(event) => {
          if (event.ctrlKey || event.metaKey || event.altKey) return;
          if (event.key === "+") moves.current?.zoomBy(1.25);
          if (event.key === "-") moves.current?.zoomBy(1 / 1.25);
          if (event.key === "0") moves.current?.fit();
        }}>
        <div class="picture" ref={sheet} onClick={activate} onKeyDown={(event) => {
          if (event.key === "Enter") void activate(event);
          if (event.key === "f") {
            const chosen = part(event);
            if (chosen?.matches(".state.open, .state.folded")) fold(chosen);
          }
          if (event.key === "b") {
            const chosen = part(event);
            const { path = "", to = "" } = chosen?.dataset ?? {};
            if (chosen?.classList.contains("state")) studio.toggleBreakpoint({ kind: "state", path });
            if (chosen?.classList.contains("transition")) studio.toggleBreakpoint({ kind: "transition", from: path, to });
          }
        }} />
        <div class="shield" ref={shield} hidden />
      </div>
    </section>
  );
}
