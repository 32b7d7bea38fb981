// Holds the engine of the page against the command: `node test/traces.mjs ESM ROOT DIST`.
// All missions that ship, and all worlds: the same trace, byte for byte, and the same diagnostics.
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { basename, join } from "node:path";
import { instance, moduleOf, texts } from "./engine.mjs";

const [esm, root, dist] = process.argv.slice(2);
const folder = join(root, "missions");
const files = texts(folder, ".esm");
const worlds = texts(folder, ".world");
const module = await moduleOf(dist);
const out = mkdtempSync(join(tmpdir(), "studio-"));
let passed = 0;
let failed = 0;

function check(name, run) {
  try {
    run();
    passed += 1;
  } catch (error) {
    failed += 1;
    console.error(`FAILED ${name}: ${String(error.message ?? error).slice(0, 600)}`);
  }
}

function command(words) {
  try {
    return { status: 0, out: execFileSync(esm, words, { cwd: root, encoding: "utf8", stdio: ["ignore", "pipe", "pipe"] }) };
  } catch (error) {
    return { status: error.status, out: error.stdout, words: error.stderr };
  }
}

function pageRun(plan) {
  const call = instance(module);
  call({ call: "files", files: plan.files ?? files });
  call({ call: "start", seed: 1, ...plan });
  // In slices, as the page does.
  const walls = [];
  for (let to_us = 3_000_000; ; to_us += 3_000_000) {
    const part = call({ call: "go_on", to_us });
    walls.push(...part.walls);
    if (!part.goes_on) return { ...part, walls, call };
  }
}

/** The first line in which two traces differ. */
function same(page, command) {
  if (page === command) return;
  const [a, b] = [page.split("\n"), command.split("\n")];
  const at = a.findIndex((line, index) => line !== b[index]);
  assert.fail(`the traces differ in line ${at + 1} of ${a.length} and ${b.length}:\npage    ${a[at]}\ncommand ${b[at]}`);
}

const trace = join(out, "trace.jsonl");
const isMission = (path) => /machine\s+\w+\s*\{/.test(files[path]) && !path.includes("/solutions/");
const runs = Object.keys(files).filter(isMission).map((path) => [path, "office"]);
for (const world of Object.keys(worlds)) runs.push(["/missions/patrol.esm", basename(world, ".world")]);
for (const [path, world] of runs) {
  check(`${path} in ${world}`, () => {
    const until_s = 12;
    const onDisk = join(root, path);
    const place = join(folder, "worlds", `${world}.world`);
    const run = command(["run", onDisk, "--board", "host", "--world", place, "--until", `${until_s} s`, "--trace", trace]);
    const page = pageRun({ path, world: worlds[`/missions/worlds/${world}.world`], until_us: until_s * 1e6 });
    assert.ok(run.status <= 1, `esm run ended with ${run.status}: ${run.words}`);
    same(page.end.trace, readFileSync(trace, "utf8"));
    assert.ok(page.end.macro_steps > 0);
  });
}

check("a sonar that dies, and the emergency stop", () => {
  const words = ["--break", "sonar 0 dead at 2500 ms", "--estop", "8 s", "--until", "10 s", "--trace", trace];
  command(["run", "missions/patrol.esm", "--board", "host", ...words]);
  const page = pageRun({
    path: "/missions/patrol.esm", world: worlds["/missions/worlds/office.world"], until_us: 10e6,
    breaks: [{ sonar: 0, fault: "dead", at_us: 2_500_000 }], stop_at_us: 8_000_000,
  });
  same(page.end.trace, readFileSync(trace, "utf8"));
});

check("a wall that comes, and a wheel that something holds", () => {
  const world = join(out, "walled.world");
  const text = `${worlds["/missions/worlds/office.world"]}\nwall 1.2,1.4 1.8,1.9 from 2500 ms\n`;
  writeFileSync(world, text);
  const words = ["--world", world, "--break", "wheel right at 6 s", "--until", "9 s", "--trace", trace];
  command(["run", "missions/patrol.esm", "--board", "host", ...words]);
  const stuck = [{ wheel: "right", at_us: 6_000_000 }];
  const page = pageRun({ path: "/missions/patrol.esm", world: text, until_us: 9e6, stuck });
  same(page.end.trace, readFileSync(trace, "utf8"));
  assert.equal(page.walls.length, 1);
  const plain = pageRun({ path: "/missions/patrol.esm", world: worlds["/missions/worlds/office.world"], until_us: 9e6 });
  assert.notEqual(plain.end.trace, page.end.trace);
});

check("a changed mission that takes over warm", () => {
  const changed = join(out, "changed.esm");
  const text = files["/missions/patrol.esm"].replace("timeout 4 s", "timeout 3 s").replace('use "rover.esm"', `use "${join(folder, "rover.esm")}"`);
  writeFileSync(changed, text);
  const words = ["--link", "uart", "--warm", "--then", `5 s ${changed}`, "--until", "9 s", "--trace", trace];
  const run = command(["run", "missions/patrol.esm", "--board", "host", ...words]);
  assert.equal(run.status, 0, run.words);
  const plan = {
    path: "/missions/patrol.esm", world: worlds["/missions/worlds/office.world"], until_us: 9e6,
    then: [{ at_us: 5_000_000, path: "/change1/missions/patrol.esm", warm: true }],
  };
  const all = { ...files, "/change1/missions/patrol.esm": text.replace(`use "${join(folder, "rover.esm")}"`, 'use "rover.esm"'), "/change1/missions/rover.esm": files["/missions/rover.esm"] };
  const page = pageRun({ ...plan, files: all });
  same(page.end.trace, readFileSync(trace, "utf8"));
  assert.ok(page.carried[1] > 0, "regions that went on as they were");
});

check("what is said of a mission with mistakes", () => {
  const broken = join(out, "broken.esm");
  const text = files["/missions/patrol.esm"].replace("state Pause", "state Pauze").replace('use "rover.esm"', `use "${join(folder, "rover.esm")}"`);
  writeFileSync(broken, text);
  const run = command(["check", broken, "--json"]);
  assert.equal(run.status, 1);
  const told = run.out.trim().split("\n").map((line) => JSON.parse(line));
  const call = instance(module);
  const inPage = text.replace(`use "${join(folder, "rover.esm")}"`, 'use "rover.esm"');
  call({ call: "files", files: { ...files, "/missions/broken.esm": inPage } });
  const page = call({ call: "build", path: "/missions/broken.esm" }).diagnostics;
  const plain = ({ code, line, col, message }) => ({ code, line, col, message });
  assert.deepEqual(page.map(plain), told.map(plain));
  assert.equal(call({ call: "draw", path: "/missions/broken.esm" }).svg, null);
});

check("guards at a moment", () => {
  const page = pageRun({ path: "/missions/patrol.esm", world: worlds["/missions/worlds/office.world"], until_us: 12e6 });
  const taken = page.end.trace.split("\n").filter(Boolean).map((line) => JSON.parse(line)).filter((line) => line.kind === "transition");
  assert.ok(taken.length > 3);
  for (const line of taken) {
    const choices = page.call({ call: "choices", t_us: line.t_us });
    assert.equal(choices.step, line.step);
    const chosen = choices.micro_steps[line.micro].choices.filter((it) => it.taken);
    const found = chosen.find((it) => it.from === line.from && it.to === line.to);
    assert.ok(found && found.holds && found.heard, `${line.from} -> ${line.to} at ${line.t_us}`);
  }
});

check("why a transition was not taken", () => {
  const page = pageRun({ path: "/missions/patrol.esm", world: worlds["/missions/worlds/office.world"], until_us: 20e6 });
  let asked = 0;
  for (let t_us = 500_000; t_us < 20e6; t_us += 1_300_000) {
    const choices = page.call({ call: "choices", t_us });
    for (const choice of choices.micro_steps[0].choices) {
      const [told] = page.call({ call: "missing", t_us, from: choice.from, to: choice.to })
        .filter((it) => it.guard === choice.guard);
      // The terms are those that the guard was evaluated with, and turning what is missing over makes it true.
      assert.deepEqual(told.terms.map((it) => [it.name, it.set]), choice.terms);
      assert.equal(told.missing.some((set) => set.length === 0), choice.holds, `${choice.from} -> ${choice.to} at ${t_us}`);
      for (const term of told.terms) {
        // Just before, the term was another one, or its state was not current.
        if (term.since.first) continue;
        const [before] = page.call({ call: "missing", t_us: term.since.t_us - 1, from: choice.from, to: choice.to })
          .filter((it) => it.guard === choice.guard);
        const then = before.terms.find((it) => it.name === term.name);
        assert.equal(then.set, !term.set, `${choice.from} -> ${choice.to}, ${term.name} at ${t_us}`);
        asked += 1;
      }
      for (const [number, [name]] of choice.terms.entries()) {
        const changes = page.call({ call: "term", from: choice.from, to: choice.to, number: 0, term: name });
        const last = changes.filter(([at]) => at <= t_us).at(-1);
        const same = page.call({ call: "missing", t_us, from: choice.from, to: choice.to })[0].terms.find((it) => it.name === name);
        if (same) assert.equal(last[1], same.set, `${name} at ${t_us}`);
        assert.ok(number >= 0);
      }
    }
  }
  assert.ok(asked > 10, `${asked} terms that have changed`);
});

check("a recording, and one that grows, have what the run had", () => {
  const recording = join(out, "patrol.rec");
  // So long that what came first is settled while more comes.
  const words = ["--until", "80 s", "--record", recording, "--trace", trace];
  command(["run", "missions/patrol.esm", "--board", "host", ...words]);
  const lines = readFileSync(trace, "utf8").trim().split("\n").map((line) => JSON.parse(line));
  const taken = lines.filter((line) => line.kind === "transition" && line.step > 0).map((line) => [line.t_us, line.from, line.to]);
  const bytes = readFileSync(recording);
  const call = instance(module);
  const whole = call({ call: "record" }, bytes);
  assert.equal(whole.ended, null);
  assert.deepEqual(whole.transitions.filter(([t_us]) => t_us > 0).map(([t_us, from, to]) => [t_us, from, to]), taken);
  assert.ok(whole.shown.length > 150 && whole.hash && whole.missions[0].name === "patrol");
  const pose = call({ call: "curve", name: "position/Track.pose x" });
  assert.deepEqual(pose.map(([, x]) => x), whole.shown.map((it) => it[1]));
  for (const [t_us, active] of whole.active.slice(1)) {
    const line = lines.findLast((line) => line.kind === "step" && line.t_us <= t_us);
    assert.deepEqual([...active].sort(), [...line.active].sort(), `at ${t_us}`);
  }
  // In parts that end with a frame each, as the command sends them.
  const ends = [];
  for (let at = 8; at < bytes.length; at += 9 + bytes.readUInt32LE(at + 1)) ends.push(at + 9 + bytes.readUInt32LE(at + 1));
  const [growing, asked] = [instance(module), instance(module)];
  const [active, transitions, shown] = [[], [], []];
  for (const [index, end] of ends.entries()) {
    const part = growing({ call: "news", steps: null }, bytes.subarray(index === 0 ? 0 : ends[index - 1], end));
    asked({ call: "hear", steps: null }, bytes.subarray(index === 0 ? 0 : ends[index - 1], end));
    if (!part) continue;
    assert.equal(part.mission_start_us, 0);
    assert.equal(part.start_us, whole.start_us);
    assert.deepEqual(part.missions.map((it) => [it.name, it.start_us]), [["patrol", 0]]);
    // The newest moment, and one long ago.
    for (const t_us of part.end_us < 1e6 ? [] : [part.end_us - 20_000, Math.round(part.end_us / 3)]) {
      assert.deepEqual(asked({ call: "choices", t_us }), call({ call: "choices", t_us }), `at ${t_us}`);
    }
    active.splice(part.kept[0], Infinity, ...part.active);
    transitions.splice(part.kept[1], Infinity, ...part.transitions);
    shown.splice(part.kept[2], Infinity, ...part.shown);
  }
  assert.deepEqual(transitions, whole.transitions);
  assert.deepEqual(shown, whole.shown);
  assert.deepEqual(active, whole.active);
  assert.deepEqual(asked({ call: "curve", name: "position/Track.pose x" }), pose);
  assert.throws(() => instance(module)({ call: "record" }, Buffer.from("ESMREC")), /empty/);
  assert.throws(() => instance(module)({ call: "record" }, Buffer.from("nothing")), /no recording/);
});

check("what is no request", () => {
  const call = instance(module);
  assert.throws(() => call({ call: "nothing" }), /cannot be read/);
  assert.throws(() => call({ call: "start", path: "/none.esm", world: "", seed: 1, until_us: 1 }), /none\.esm/);
  assert.throws(() => call({ call: "go_on", to_us: 1 }), /no run/);
});

rmSync(out, { recursive: true });
console.log(`${passed} passed, ${failed} failed`);
process.exit(failed === 0 ? 0 : 1);
