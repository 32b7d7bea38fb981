// Measures what the studio takes: `node test/measure.mjs ROOT DIST [ESM]`. With the command, in a browser, too.
import { execFileSync, spawn } from "node:child_process";
import { existsSync, mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { createInterface } from "node:readline";
import { gzipSync } from "node:zlib";
import { instance, moduleOf, texts } from "./engine.mjs";

const [root, dist, esm] = process.argv.slice(2);
const packed = (name) => gzipSync(readFileSync(join(dist, name)), { level: 9 }).length;
const module_bytes = readFileSync(join(dist, "engine.wasm.gz")).length;
const script_bytes = ["studio.js", "worker.js", "studio.css", "index.html"].map(packed).reduce((a, b) => a + b);
const files = texts(join(root, "missions"), ".esm");
const world = readFileSync(join(root, "missions/worlds/office.world"), "utf8");
const module = await moduleOf(dist);

const runs = [];
for (let round = 0; round < 5; round++) {
  const call = instance(module);
  call({ call: "files", files });
  call({ call: "start", path: "/missions/patrol.esm", world, seed: 1, until_us: 120e6 });
  const begun = performance.now();
  call({ call: "go_on", to_us: 130e6 });
  runs.push(performance.now() - begun);
}
const call = instance(module);
call({ call: "files", files });
const serve = (...messages) => call({ call: "serve", now_ms: performance.now(), messages: messages.map((it) => ({ jsonrpc: "2.0", ...it })) });
serve({ id: 0, method: "initialize", params: { rootUri: "file:///", capabilities: {} } }, { method: "initialized", params: {} });
/** A machine of 500 states in 50 regions. */
function large() {
  const regions = Array.from({ length: 50 }, (_, region) => {
    const states = Array.from({ length: 10 }, (_, state) => `state S${state} timeout 1 s;`).join(" ");
    const ways = Array.from({ length: 10 }, (_, state) => `S${state} -> S${(state + 1) % 10} [timeout];`).join(" ");
    return `region r${region} { ${states} initial -> S0; ${ways} }`;
  });
  return `interpreter slot 1;\nslot 1 period 20 ms duration 10 ms;\nmachine Large {\n${regions.join("\n")}\n}\n`;
}

/** From a key press to diagnostics and picture, in milliseconds, of each of some key presses. */
function keyPresses(path, text, count) {
  const uri = `file://${path}`;
  serve({ method: "textDocument/didOpen", params: { textDocument: { uri, languageId: "esm", version: 0, text } } });
  const times = [];
  for (let version = 1; version <= count; version++) {
    const changed = `${text}\n// ${"x".repeat(version)}`;
    const begun = performance.now();
    const answer = serve({ method: "textDocument/didChange", params: { textDocument: { uri, version }, contentChanges: [{ text: changed }] } });
    call({ call: "files", files: { ...files, [path]: changed } });
    const drawn = call({ call: "draw", path });
    times.push(performance.now() - begun);
    const isTold = answer.messages.some((it) => it.method === "textDocument/publishDiagnostics");
    if (!isTold || !drawn.svg) throw new Error(`${path}: no diagnostics, or no picture: ${drawn.reason}`);
  }
  serve({ method: "textDocument/didClose", params: { textDocument: { uri } } });
  return times;
}
const at = (list, part) => [...list].sort((a, b) => a - b)[Math.floor(part * (list.length - 1))];
console.log(JSON.stringify({
  module_bytes, script_bytes, page_bytes: module_bytes + script_bytes,
  patrol_120_s_ms: Math.round(Math.min(...runs)), key_to_picture_p95_ms: Math.round(at(keyPresses("/missions/patrol.esm", files["/missions/patrol.esm"], 60), 0.95)),
  key_to_picture_of_500_states_p95_ms: Math.round(at(keyPresses("/missions/large.esm", large(), 40), 0.95)),
  ...(esm ? await ofBrowser() : {}),
}));
process.exit(0);

/** Starts a command, and answers what it says first. */
async function started(words) {
  const child = spawn(esm, words, { stdio: ["pipe", "pipe", "inherit"], cwd: root });
  return { child, said: await new Promise((done) => createInterface(child.stdout).once("line", done)) };
}

/** What takes a browser. */
async function ofBrowser() {
  const { chromium } = await import("playwright-core");
  const browsers = ["/usr/bin/chromium", "/usr/bin/chromium-browser", "/usr/bin/google-chrome"];
  const executablePath = process.env.CHROMIUM ?? browsers.find(existsSync);
  const browser = await chromium.launch({ executablePath, args: ["--no-sandbox"] });
  const server = await started(["studio", "--json"]);
  const { address } = JSON.parse(server.said);
  const folder = mkdtempSync(join(tmpdir(), "studio-"));
  try {
    return {
      ...await opening(browser, address),
      pan_500_states_frame_p95_ms: await panning(browser, address),
      step_back_in_an_hour_p95_ms: stepBack(folder),
      ...await highlight(browser),
    };
  } finally {
    await browser.close();
    server.child.kill("SIGINT");
    rmSync(folder, { recursive: true });
  }
}

/** From opening to a robot that drives, in milliseconds: over 10 Mbit/s with nothing kept, and again from what the browser keeps. */
async function opening(browser, address) {
  const drives = async (page) => {
    const begun = performance.now();
    await page.goto(`${address}#open=patrol`, { waitUntil: "commit" });
    await page.waitForFunction(() => Number.parseFloat(document.querySelector(".clock")?.textContent) > 0, null, { polling: "raf" });
    return performance.now() - begun;
  };
  const [cold, warm] = [[], []];
  for (let round = 0; round < 3; round++) {
    const context = await browser.newContext({ viewport: { width: 1440, height: 900 } });
    const page = await context.newPage();
    const tools = await context.newCDPSession(page);
    await tools.send("Network.enable");
    const bytes_per_s = 10e6 / 8;
    const slow = { offline: false, latency: 20, downloadThroughput: bytes_per_s, uploadThroughput: bytes_per_s };
    await tools.send("Network.emulateNetworkConditions", slow);
    cold.push(await drives(page));
    const fast = { offline: false, latency: 0, downloadThroughput: -1, uploadThroughput: -1 };
    await tools.send("Network.emulateNetworkConditions", fast);
    await page.goto("about:blank");
    warm.push(await drives(page));
    await context.close();
  }
  return { cold_10_mbit_to_driving_ms: Math.round(at(cold, 0.5)), warm_to_driving_ms: Math.round(at(warm, 0.5)) };
}

/** Work of the main thread for a frame while 500 states are dragged about, in milliseconds. */
async function panning(browser, address) {
  const context = await browser.newContext({ viewport: { width: 1440, height: 900 } });
  const page = await context.newPage();
  await page.addInitScript((text) => {
    localStorage.setItem("esm.toured", "yes");
    localStorage.setItem("esm.files", JSON.stringify({ "/yours/large.esm": text }));
    localStorage.setItem("esm.path", "/yours/large.esm");
  }, large());
  await page.goto(address);
  await page.waitForFunction(() => document.querySelectorAll(".sheet g.state").length >= 500);
  await page.locator(".diagram .sheet").focus();
  for (let press = 0; press < 6; press++) await page.keyboard.press("+");
  // As large as it is dragged, and still.
  await page.waitForFunction(() => {
    const [box, picture] = [".diagram .sheet", ".diagram .sheet svg"].map((it) => document.querySelector(it));
    return picture.clientWidth > 3 * box.clientWidth;
  });
  const box = await page.locator(".diagram .sheet").boundingBox();
  await browser.startTracing(page, { categories: ["devtools.timeline", "disabled-by-default-devtools.timeline"] });
  await page.mouse.move(box.x + 250, box.y + 150);
  await page.mouse.down();
  for (let step = 0; step < 90; step++) {
    await page.mouse.move(box.x + 250 - 2 * step, box.y + 150 - step);
    await page.waitForTimeout(8);
  }
  await page.mouse.up();
  const trace = JSON.parse((await browser.stopTracing()).toString());
  await context.close();
  const name = (event) => event.args?.data?.name ?? event.args?.name;
  const main = trace.traceEvents.find((event) => event.name === "thread_name" && name(event) === "CrRendererMain"
    && trace.traceEvents.some((other) => other.tid === event.tid && other.pid === event.pid && other.name === "EventDispatch"));
  const tasks = trace.traceEvents.filter((event) => (
    event.tid === main.tid && event.pid === main.pid && event.ph === "X" && /RunTask$/.test(event.name)));
  const moves = trace.traceEvents.filter((event) => (
    event.tid === main.tid && event.pid === main.pid && event.name === "EventDispatch" && event.args.data?.type === "pointermove"))
    .map((event) => event.ts);
  if (moves.length < 60) throw new Error(`${moves.length} moves are too few to measure`);
  const frame_us = 1e6 / 60;
  const work = [];
  for (let from = Math.min(...moves); from < Math.max(...moves); from += frame_us) {
    const of_frame = tasks.filter((task) => task.ts >= from && task.ts < from + frame_us);
    work.push(of_frame.reduce((sum, task) => sum + task.dur / 1000, 0));
  }
  return Math.round(at(work, 0.95) * 10) / 10;
}

/** How long it takes to go a step back in a recording of an hour, with all that the page shows of it, in milliseconds. */
function stepBack(folder) {
  const recording = join(folder, "hour.rec");
  execFileSync(esm, ["run", "missions/patrol.esm", "--board", "host", "--until", "3600 s", "--record", recording], { cwd: root, stdio: "ignore" });
  const call = instance(module);
  call({ call: "record" }, readFileSync(recording));
  const times = [];
  for (let back = 0; back < 400; back++) {
    const begun = performance.now();
    // From anywhere, and backwards.
    call({ call: "choices", t_us: 3_590e6 - back * 7_980_000 });
    times.push(performance.now() - begun);
  }
  return Math.round(at(times, 0.95) * 10) / 10;
}

/** From a transition on a robot, at the other end of a line of 115,200 baud, to where the page knows of it, in milliseconds. */
async function highlight(browser) {
  const { lineOf } = await import("./live.mjs");
  const board = await started(["board", "--board", "host"]);
  const port = board.said.match(/^the robot is at ([^;]+);/)[1];
  execFileSync(esm, ["upload", "missions/patrol.esm", "--port", port], { cwd: root, stdio: "ignore" });
  const line = await lineOf(port, 115_200);
  const server = await started(["studio", "--json", "--port", line.port]);
  const context = await browser.newContext({ viewport: { width: 1440, height: 900 } });
  const page = await context.newPage();
  await page.addInitScript(() => localStorage.setItem("esm.toured", "yes"));
  await page.goto(JSON.parse(server.said).address);
  await page.waitForSelector("section.time[data-behind-ms]", { state: "attached", timeout: 20_000 });
  // The robot's clock is known better with each answer.
  await page.waitForTimeout(5_000);
  const seen = await page.evaluate(() => new Promise((done) => {
    const all = [];
    const time = document.querySelector("section.time");
    // The frame behind the change shows it.
    new MutationObserver(() => {
      const told = performance.now();
      const behind = Number(time.dataset.behindMs);
      requestAnimationFrame(() => setTimeout(() => all.push(behind + performance.now() - told)));
    }).observe(time, { attributes: true, attributeFilter: ["data-behind-ms"] });
    setTimeout(() => done(all), 60_000);
  }));
  await context.close();
  server.child.kill("SIGINT");
  await new Promise((done) => server.child.once("exit", done));
  line.close();
  board.child.kill("SIGINT");
  if (seen.length < 20) throw new Error(`${seen.length} transitions are too few to measure`);
  const [half, most, all] = [0.5, 0.95, 1].map((part) => Math.round(at(seen, part)));
  return {
    highlight_at_115200_baud_p50_ms: half, highlight_at_115200_baud_p95_ms: most, highlight_at_115200_baud_max_ms: all,
    highlights: seen.length,
  };
}
