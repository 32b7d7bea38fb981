// What drives and measures the CD player of an engine in JavaScript, and tells it as the other programs do: `tell NAME COUNTS` and `row NAME EVENTS NANOSECONDS...`.

/** The actions, in the order of their counts. */
export const ACTIONS = [
  'start_playback', 'open_drawer', 'close_drawer', 'store_cd_info', 'stop_playback', 'pause_playback',
  'resume_playback', 'stop_and_open', 'stopped_again', 'next_song', 'previous_song',
];

// Atomic operations are not optimised away, and stores to shared memory are not merged.
const counters = new Int32Array(new SharedArrayBuffer(4 * ACTIONS.length));

/** A function that counts one action. */
export function action(name) {
  const index = ACTIONS.indexOf(name);
  return () => { Atomics.store(counters, index, Atomics.load(counters, index) + 1); };
}

const SONGS = ['next', 'next', 'prev', 'prev'];
/** What is done to the player in one pass, which ends where it began. */
const SCRIPT = [
  'open_close', 'open_close', 'cd', 'play',
  ...Array.from({ length: 10 }, () => SONGS).flat(),
  'pause', 'end_pause', 'pause', 'stop', 'stop', 'open_close', 'open_close',
];

/** Nanoseconds that one measurement takes at least, how many there are, and how long they are prepared: until the engine's code is compiled. */
const LONG_ENOUGH_NS = 20_000_000n;
const MEASUREMENTS = 10;
const PASSES_BEFORE = 5_000;

/** Measures an engine. `event` makes what `dispatch` takes from an event's name; it is made once, not each time. */
export function measure(name, event, dispatch) {
  const script = SCRIPT.map(event);
  const pass = () => { for (const event of script) dispatch(event); };
  pass();
  const before = [...counters];
  pass();
  console.log(`tell cd51-${name} ${[...counters].map((count, index) => count - before[index]).join(' ')}`);
  const of = (times) => {
    const started = process.hrtime.bigint();
    for (let time = 0; time < times; time += 1) pass();
    return process.hrtime.bigint() - started;
  };
  of(PASSES_BEFORE);
  let times = 1;
  while (of(times) < LONG_ENOUGH_NS) times *= 2;
  const nanoseconds = Array.from({ length: MEASUREMENTS }, () => (Number(of(times)) / times).toFixed(1));
  console.log(`row cd51-${name} ${script.length} ${nanoseconds.join(' ')}`);
}
