import { useEffect, useRef, useState } from "preact/hooks";
import type { Studio } from "./studio";

const LEAST = 0.15;
const MOST = 3;

/** The state diagram: the engine's own picture, with what is current lit. */
export function Diagram({ studio }: { studio: Studio }) {
  const words = studio.words;
  const box = useRef<HTMLDivElement>(null);
  const sheet = useRef<HTMLDivElement>(null);
  const [zoom, setZoom] = useState(0);
  const [search, setSearch] = useState("");
  const svg = studio.drawn?.svg ?? null;

  const fit = () => {
    const picture = sheet.current?.querySelector("svg");
    // A part that is not shown has no width.
    if (!picture || !box.current?.clientWidth) return;
    const width = picture.viewBox.baseVal.width;
    setZoom(Math.min(1.2, Math.max(LEAST, (box.current.clientWidth - 18) / width)));
  };

  useEffect(() => {
    if (!sheet.current) return;
    sheet.current.innerHTML = svg ?? "";
    for (const part of sheet.current.querySelectorAll<SVGGElement>("g.state")) {
      const path = part.dataset.path ?? "";
      part.setAttribute("tabindex", "0");
      part.setAttribute("role", "button");
      const shown = [...part.querySelectorAll("text")].map((text) => text.textContent).join(" ");
      part.setAttribute("aria-label", `${shown}, ${path}`);
      const first = part.querySelector("rect");
      if (!first) continue;
      const circle = document.createElementNS("http://www.w3.org/2000/svg", "circle");
      circle.setAttribute("class", "breakpoint");
      circle.setAttribute("cx", String(Number(first.getAttribute("x")) + 7));
      circle.setAttribute("cy", String(Number(first.getAttribute("y")) + 7));
      circle.setAttribute("r", "4");
      part.append(circle);
    }
    const picture = sheet.current.querySelector("svg");
    picture?.setAttribute("role", "group");
    picture?.setAttribute("aria-label", words.diagramLabel);
  }, [svg, studio.language]);

  // Another file has another picture.
  useEffect(() => setZoom(0), [studio.path]);
  useEffect(() => {
    if (zoom === 0) fit();
  }, [zoom, svg, studio.tab]);

  useEffect(() => {
    const picture = sheet.current?.querySelector("svg");
    if (!picture || zoom === 0) return;
    picture.style.width = `${picture.viewBox.baseVal.width * zoom}px`;
    picture.style.height = `${picture.viewBox.baseVal.height * zoom}px`;
  }, [svg, zoom]);

  const active = studio.run?.activeAt(studio.t_us) ?? [];
  const key = active.join(" ");
  const breaks = [...studio.breakpoints].join(" ");
  useEffect(() => {
    const lit = new Set(active);
    for (const part of sheet.current?.querySelectorAll<SVGGElement>("g[data-path]") ?? []) {
      const path = part.dataset.path ?? "";
      part.classList.toggle("lit", !part.classList.contains("transition") && lit.has(path));
      part.classList.toggle("breaks", studio.breakpoints.has(path));
      const isFound = search !== "" && path.toLowerCase().includes(search.toLowerCase());
      part.classList.toggle("found", isFound && part.classList.contains("state"));
    }
  }, [svg, key, breaks, search]);

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

  const part = (event: Event) => (event.target as Element).closest<SVGGElement>("g[data-start]");
  const activate = async (event: Event) => {
    const chosen = part(event);
    if (!chosen) return;
    if ((event.target as Element).classList.contains("breakpoint")) {
      studio.toggleBreakpoint(chosen.dataset.path ?? "");
      return;
    }
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
          onInput={(event) => setSearch(event.currentTarget.value)} />
        <label><input type="checkbox" checked={studio.folds}
          onChange={() => { studio.folds = !studio.folds; void studio.draw(); }} /> {words.folds}</label>
        <label><input type="checkbox" checked={studio.showsData}
          onChange={() => { studio.showsData = !studio.showsData; void studio.draw(); }} /> {words.data}</label>
        <span class="group">
          <button onClick={() => setZoom(Math.max(LEAST, zoom / 1.25))} aria-label={words.zoomOut} title={words.zoomOut}>−</button>
          <button onClick={fit} title={words.fit}>{words.fit}</button>
          <button onClick={() => setZoom(Math.min(MOST, zoom * 1.25))} aria-label={words.zoomIn} title={words.zoomIn}>+</button>
        </span>
      </header>
      {studio.isStale && <p class="note" role="status">{svg ? words.stays : studio.drawn?.reason ?? words.noDiagram}</p>}
      <div class={`sheet ${studio.isStale ? "stale" : ""}`} ref={box} tabIndex={0} role="region" aria-label={words.diagramLabel}
        onWheel={(event) => {
          if (!event.ctrlKey) return;
          event.preventDefault();
          setZoom(Math.min(MOST, Math.max(LEAST, zoom * (event.deltaY < 0 ? 1.1 : 1 / 1.1))));
        }}>
        <div ref={sheet} onClick={activate} onKeyDown={(event) => {
          if (event.key === "Enter") void activate(event);
          if (event.key === "b") {
            const chosen = part(event);
            if (chosen?.classList.contains("state")) studio.toggleBreakpoint(chosen.dataset.path ?? "");
          }
        }} />
      </div>
    </section>
  );
}
