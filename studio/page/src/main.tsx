import { render } from "preact";
import { useEffect, useReducer, useRef } from "preact/hooks";
import { Diagram } from "./diagram";
import { Robot } from "./robot";
import { Studio } from "./studio";
import { Time } from "./time";
import { Why } from "./why";
import { languages } from "./words";

function base(path: string): string {
  return path.split("/").pop() ?? path;
}

function Head({ studio }: { studio: Studio }) {
  const words = studio.words;
  const all = [...new Set([...Object.keys(studio.shipped), ...Object.keys(studio.own)])].sort();
  const missions = all.filter((path) => path.endsWith(".esm"));
  const groups: [string, string[]][] = [
    [words.given, missions.filter((path) => studio.given.includes(path))],
    [words.own, missions.filter((path) => !(path in studio.shipped))],
    [words.missions, missions.filter((path) => /^\/missions\/[^/]+$/.test(path))],
    [words.tutorial, missions.filter((path) => /^\/missions\/tutorial\//.test(path))],
  ];
  const worlds = all.filter((path) => path.endsWith(".world"));
  return (
    <header class="head">
      <h1><span aria-hidden="true" class="mark" />{words.title}</h1>
      <label>{words.example} <select value={studio.path} onChange={(event) => void studio.openFile(event.currentTarget.value)}>
        {groups.filter(([, list]) => list.length > 0).map(([name, list]) => (
          <optgroup label={name}>{list.map((path) => (
            <option value={path} selected={path === studio.path}>{base(path).replace(/\.esm$/, "")}{path in studio.own && path in studio.shipped ? " *" : ""}</option>
          ))}</optgroup>
        ))}
      </select></label>
      <label>{words.world} <select value={studio.worldPath} onChange={(event) => void studio.openWorld(event.currentTarget.value)}>
        {worlds.map((path) => <option value={path} selected={path === studio.worldPath}>{base(path).replace(/\.world$/, "")}</option>)}
      </select></label>
      <span class="group">
        <button onClick={() => void studio.openFromDisk()}>{words.open}</button>
        <button onClick={() => studio.saveToDisk()} title="Ctrl+S">{words.save}</button>
        <button onClick={() => void studio.share()} title={words.shareHelp}>{words.share}</button>
      </span>
      <span class="space" />
      <select aria-label="Language, Sprache" value={studio.language} onChange={(event) => studio.setLanguage(event.currentTarget.value)}>
        {Object.entries(languages).map(([tag, words]) => <option value={tag} selected={tag === studio.language}>{words.language}</option>)}
      </select>
      <button onClick={() => studio.toggleTheme()} aria-label={words.theme} title={words.theme}>◐</button>
      <button onClick={() => studio.set({ tour: 0 })}>{words.tour}</button>
    </header>
  );
}

function Text({ studio, place }: { studio: Studio; place: { current: HTMLDivElement | null } }) {
  const words = studio.words;
  const isChanged = studio.path in studio.own && studio.path in studio.shipped;
  return (
    <section class={`panel text ${studio.tab === "text" ? "shown" : ""}`} aria-label={words.text} id="text">
      <header>
        <h2>{base(studio.path)}</h2>
        <span class="space" />
        {isChanged && <button onClick={() => studio.restore()} title={words.restoreHelp}>{words.restore}</button>}
        <button onClick={() => studio.editor?.format()} title="Shift+Alt+F">{words.format}</button>
      </header>
      <div class="editor" ref={place} />
      <div class="problems" role="region" aria-label={words.problems} aria-live="polite" tabIndex={0}>
        {studio.problems.length === 0 ? <p class="none">{studio.isLoaded ? words.noProblems : words.loading}</p> : (
          <ul>{studio.problems.map((problem) => (
            <li class={problem.severity === 1 ? "error" : "warning"}>
              <button class="plain" onClick={() => studio.editor.goToOffset(studio.editor.offset(problem.range.start))}>
                <strong>{problem.code}</strong> {words.line} {problem.range.start.line + 1}: {problem.message}
              </button>
              {problem.fixes.map((fix) => <button class="fix" onClick={() => studio.editor.fix(fix)}>{words.fix}: {fix.title}</button>)}
            </li>
          ))}</ul>
        )}
      </div>
    </section>
  );
}

function Tour({ studio }: { studio: Studio }) {
  const words = studio.words;
  const dialog = useRef<HTMLDialogElement>(null);
  const at = studio.tour;
  const step = words.tourSteps[at];
  useEffect(() => {
    if (step && !dialog.current?.open) dialog.current?.show();
    dialog.current?.querySelector<HTMLButtonElement>("button.main")?.focus();
  }, [at]);
  const target = ["text", "diagram", "time", "robot", "time", "why"][at];
  useEffect(() => {
    for (const panel of document.querySelectorAll(".panel")) {
      panel.classList.toggle("toured", at >= 0 && panel.classList.contains(target));
    }
    if (target && target !== "time") studio.set({ tab: target as Studio["tab"] });
  }, [at]);
  if (!step) return null;
  const isLast = at === words.tourSteps.length - 1;
  return (
    <dialog ref={dialog} class="tour" aria-labelledby="tour-title" onClose={() => studio.endTour()}>
      <h2 id="tour-title">{at + 1}/{words.tourSteps.length} {step[0]}</h2>
      <p>{step[1]}</p>
      {isLast && <p class="keys">{words.keys}</p>}
      <div class="buttons">
        <button onClick={() => studio.endTour()}>{words.close}</button>
        {at > 0 && <button onClick={() => studio.set({ tour: at - 1 })}>{words.back}</button>}
        {!isLast && <button class="main" onClick={() => studio.set({ tour: at + 1 })}>{words.next}</button>}
        {isLast && <button class="main" onClick={() => { studio.endTour(); studio.start(); }}>▶ {words.run}</button>}
      </div>
    </dialog>
  );
}

function App({ studio }: { studio: Studio }) {
  const [, again] = useReducer((count: number) => count + 1, 0);
  const place = useRef<HTMLDivElement>(null);
  useEffect(() => studio.listen(() => again(undefined)), []);
  useEffect(() => {
    void studio.begin(place.current!).catch((error) => studio.set({ message: String(error) }));
  }, []);
  const words = studio.words;
  const tabs = [["text", words.text], ["diagram", words.diagram], ["robot", words.robot], ["why", words.why]] as const;
  return (
    <>
      <Head studio={studio} />
      <nav class="tabs" aria-label={words.title}>
        {tabs.map(([tab, name]) => (
          <button aria-pressed={studio.tab === tab} onClick={() => studio.set({ tab })}>{name}</button>
        ))}
      </nav>
      {studio.message && <p class="message" role="alert"><span>{studio.message}</span>
        <button onClick={() => studio.set({ message: "" })}>{words.close}</button></p>}
      <main>
        <Text studio={studio} place={place} />
        <Diagram studio={studio} />
        <Why studio={studio} />
        <Robot studio={studio} />
        <Time studio={studio} />
      </main>
      <Tour studio={studio} />
    </>
  );
}

const studio = new Studio();
document.documentElement.lang = studio.language;
document.addEventListener("keydown", (event) => {
  const control = event.ctrlKey || event.metaKey;
  if (control && event.key === "Enter") studio.start();
  else if (event.altKey && event.key === "Enter") studio.toggle();
  else if (control && event.key === "s") studio.saveToDisk();
  else if (event.altKey && event.key === "ArrowRight" && studio.run) studio.step(1);
  else if (event.altKey && event.key === "ArrowLeft" && studio.run) studio.step(-1);
  else if (event.key === "Escape" && studio.tour >= 0) studio.endTour();
  else return;
  event.preventDefault();
}, true);
// A recording, mission or world that is dropped onto the page is opened.
document.addEventListener("dragover", (event) => event.preventDefault());
document.addEventListener("drop", (event) => {
  event.preventDefault();
  const files = [...(event.dataTransfer?.files ?? [])];
  if (files.length > 0) void studio.takeFiles(files);
});
render(<App studio={studio} />, document.getElementById("app")!);
