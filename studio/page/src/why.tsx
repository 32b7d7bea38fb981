import { seconds, type Studio } from "./studio";
import type { Choice } from "./protocol";

function name(path: string): string {
  return path.slice(path.lastIndexOf("/") + 1);
}

function Row({ choice, studio }: { choice: Choice; studio: Studio }) {
  const words = studio.words;
  const state = choice.taken ? "taken" : !choice.heard ? "waits" : choice.holds ? "holds" : "no";
  const said = { taken: words.taken, waits: words.otherEvent, holds: words.holds, no: words.holdsNot }[state];
  return (
    <li class={`choice ${state}`}>
      <span class="arrow" title={`${choice.from} → ${choice.to}`}>{name(choice.from)} → {name(choice.to)}</span>
      {choice.event !== "pulse" && <span class="event">{choice.event}</span>}
      {choice.guard && <code>[{choice.guard}]</code>}
      <span class="terms">{choice.terms.map(([term, holds]) => (
        <span class={`term ${holds ? "true" : "false"}`}>{term} {holds ? "✓" : "✗"}</span>
      ))}</span>
      <span class="said">{said}</span>
    </li>
  );
}

/** Why the machine did what it did, and why it did not: all that it had to choose from. */
export function Why({ studio }: { studio: Studio }) {
  const words = studio.words;
  const choices = studio.choices;
  const log = (studio.run?.words ?? []).filter(([t_us]) => t_us <= studio.t_us).slice(-40).reverse();
  return (
    <section class={`panel why ${studio.tab === "why" ? "shown" : ""}`} aria-label={words.why} id="why">
      <header>
        <h2>{words.why}</h2>
        {choices && <span class="facts">{words.macroStep} {choices.step} · {seconds(choices.t_us)}</span>}
      </header>
      <div class="scroll" tabIndex={0} role="region" aria-label={words.whyHelp}>
        {!choices && <p class="note">{words.whyNone}</p>}
        {choices?.micro_steps.map((micro, index) => (
          <div class="micro">
            <h3>{words.micro(index, micro.event)}</h3>
            <ul>{micro.choices
              .filter((choice) => index === 0 || choice.heard)
              .map((choice) => <Row choice={choice} studio={studio} />)}</ul>
          </div>
        ))}
        {log.length > 0 && <>
          <h3>{words.log}</h3>
          <ol class="log">{log.map(([, text]) => <li>{text.trim()}</li>)}</ol>
        </>}
      </div>
    </section>
  );
}
