import { seconds, type Studio } from "./studio";
import type { Choice, Missing, Since } from "./protocol";

function name(path: string): string {
  return path.slice(path.lastIndexOf("/") + 1);
}

/** A small round button that sets a breakpoint, or takes it back. */
function Dot({ isSet, label, onClick }: { isSet: boolean; label: string; onClick: () => void }) {
  return <button class="dot" aria-pressed={isSet} aria-label={label} title={label} onClick={onClick} />;
}

/** Why a transition was not taken: which terms were missing, and since when. */
function Reason({ missing, studio }: { missing: Missing; studio: Studio }) {
  const words = studio.words;
  const since = (it: Since) => (
    <button class="since" title={words.goThere} onClick={() => { studio.isPlaying = false; studio.seek(it.t_us); }}>
      {it.first ? words.sinceFirst : words.since(seconds(it.t_us), it.step)}
    </button>
  );
  if (!missing.current) return <p class="reason">{words.notCurrent(name(studio.asked!.from))} {since(missing.since)}</p>;
  const values = missing.terms.map((term) => (
    <li><span class={`term ${term.set ? "true" : "false"}`}>{term.name} {term.set ? "✓" : "✗"}</span> {since(term.since)}</li>
  ));
  const sets = missing.missing.map((set) => (
    set.map((place) => words.wanted(missing.terms[place].name, !missing.terms[place].set)).join(` ${words.and} `)
  ));
  const isTrue = missing.missing.length > 0 && missing.missing[0].length === 0;
  return (
    <div class="reason">
      {missing.guard && <code>[{missing.guard}]</code>}
      <p class="lacks">
        {isTrue
          ? missing.event === "pulse" ? words.lacksNothing : words.lacksEvent(missing.event)
          : sets.length === 0 ? words.lacksMuch : `${words.lacks} ${sets.join(` ${words.or} `)}`}
      </p>
      <ul>{values}</ul>
      <p class="note">{words.currentSince} {since(missing.since)}</p>
    </div>
  );
}

/** The rows of a micro step, with the terms of each guard; each can be asked about, and pauses the run. */
function Row({ choice, studio, number }: { choice: Choice; studio: Studio; number: number }) {
  const words = studio.words;
  const state = choice.taken ? "taken" : !choice.heard ? "waits" : choice.holds ? "holds" : "no";
  const said = { taken: words.taken, waits: words.otherEvent, holds: words.holds, no: words.holdsNot }[state];
  const { from, to } = choice;
  const isAsked = studio.asked?.from === from && studio.asked.to === to;
  const arrow = `${name(from)} → ${name(to)}`;
  return (
    <li class={`choice ${state}`}>
      <Dot isSet={studio.hasBreakpoint({ kind: "transition", from, to })} label={words.breakAt(words.breakTransition(name(from), name(to)))}
        onClick={() => studio.toggleBreakpoint({ kind: "transition", from, to })} />
      <button class="arrow" title={`${from} → ${to}`} aria-expanded={isAsked} onClick={() => studio.why(from, to)}>{arrow}</button>
      {choice.event !== "pulse" && <span class="event">{choice.event}</span>}
      {choice.guard && <code>[{choice.guard}]</code>}
      <span class="terms">{choice.terms.map(([term, holds]) => {
        const breakpoint = { kind: "term", from, to, number, term } as const;
        const label = words.breakAt(words.breakTerm(term, name(from), name(to)));
        return (
          <button class={`term ${holds ? "true" : "false"}`} aria-pressed={studio.hasBreakpoint(breakpoint)} title={label}
            aria-label={`${term} ${holds ? "✓" : "✗"}. ${label}`}
            onClick={() => studio.toggleBreakpoint(breakpoint)}>{term} {holds ? "✓" : "✗"}</button>
        );
      })}</span>
      <span class="said">{said}</span>
    </li>
  );
}

/** Which of the transitions from one state to another a choice is. */
function numberOf(choices: Choice[], index: number): number {
  const { from, to } = choices[index];
  return choices.slice(0, index).filter((it) => it.from === from && it.to === to).length;
}

/** Why the machine did what it did, and why it did not: all that it had to choose from. */
export function Why({ studio }: { studio: Studio }) {
  const words = studio.words;
  const choices = studio.choices;
  const asked = studio.asked;
  return (
    <section class={`panel why ${studio.tab === "why" ? "shown" : ""}`} aria-label={words.why} id="why">
      <header>
        <h2>{words.why}</h2>
        {choices && <span class="facts">{words.macroStep} {choices.step} · {seconds(choices.t_us)}</span>}
      </header>
      <div class="scroll" tabIndex={0} role="region" aria-label={words.whyHelp}>
        {!choices && <p class="note">{words.whyNone}</p>}
        {asked && (
          <section class="asked" aria-label={words.whyNot} aria-live="polite">
            <h3>{words.whyNot} {name(asked.from)} → {name(asked.to)}
              <button class="close" onClick={() => studio.why(asked.from, asked.to)}>{words.close}</button></h3>
            {studio.missing.map((missing) => <Reason missing={missing} studio={studio} />)}
          </section>
        )}
        {choices?.micro_steps.map((micro, index) => (
          <div class="micro">
            <h3>{words.micro(index, micro.event)}</h3>
            <ul>{micro.choices
              .map((choice, place) => ({ choice, number: numberOf(micro.choices, place) }))
              .filter(({ choice }) => index === 0 || choice.heard)
              .map(({ choice, number }) => <Row choice={choice} studio={studio} number={number} />)}</ul>
          </div>
        ))}
        {choices && studio.run?.kind === "recorded" && <p class="note">{words.condensed}</p>}
      </div>
    </section>
  );
}
