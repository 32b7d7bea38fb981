// Drives the page in a browser: `node test/page.mjs ESM ROOT PICTURES`. The command serves it.
import assert from "node:assert/strict";
import { execFileSync, spawn } from "node:child_process";
import { existsSync, mkdirSync, readFileSync, rmSync } from "node:fs";
import { createServer } from "node:http";
import { createRequire } from "node:module";
import { join } from "node:path";
import { createInterface } from "node:readline";
import { chromium } from "playwright-core";

const [esm, root, pictures] = process.argv.slice(2);
const browsers = ["/usr/bin/chromium", "/usr/bin/chromium-browser", "/usr/bin/google-chrome"];
const executablePath = process.env.CHROMIUM ?? browsers.find(existsSync);
const axe = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");
mkdirSync(pictures, { recursive: true });

const server = spawn(esm, ["studio", "--json", join(root, "missions/tutorial/3_gap.esm")], { stdio: ["ignore", "pipe", "inherit"] });
const address = JSON.parse(await new Promise((done) => createInterface(server.stdout).once("line", done))).address;
const browser = await chromium.launch({ executablePath, args: ["--no-sandbox"] });
let passed = 0;
let failed = 0;

/** Checks one after the other, with pages whose errors are theirs: others may run beside them. */
function lane() {
  const errors = [];
  const check = async (name, run) => {
    const before = errors.length;
    const begun = performance.now();
    try {
      await run();
      assert.deepEqual(errors.slice(before), []);
      passed += 1;
      console.log(`${((performance.now() - begun) / 1000).toFixed(1)} s: ${name}`);
    } catch (error) {
      failed += 1;
      console.error(`FAILED ${name}: ${String(error.stack ?? error).slice(0, 1500)}`);
    }
  };
  const open = async (options = {}, at = address, route = null) => {
    const context = await browser.newContext({ viewport: { width: 1440, height: 900 }, ...options });
    const page = await context.newPage();
    page.setDefaultTimeout(30_000);
    page.on("console", (message) => {
      if (message.type() === "error") errors.push(message.text());
    });
    page.on("pageerror", (error) => errors.push(error.message));
    if (route) await page.route("**/worker.js", route);
    await page.goto(at);
    await page.waitForSelector(".sheet svg", { state: "attached" });
    return page;
  };
  return { check, open, errors };
}

/** Starts a command that says something on its first line, which `read` takes. */
async function started(words, read) {
  const child = spawn(esm, words, { stdio: ["pipe", "pipe", "inherit"], cwd: root });
  return { child, said: read(await new Promise((done) => createInterface(child.stdout).once("line", done))) };
}

const note = (page, pattern) => page.waitForFunction((source) => new RegExp(source).test(document.querySelector(".time .note").textContent), pattern.source);

const clock = (page) => page.locator(".clock").textContent().then((text) => Number.parseFloat(text));
const at = (page, seconds) => page.waitForFunction((least) => Number.parseFloat(document.querySelector(".clock").textContent) >= least, seconds);
const whole = (page) => page.waitForSelector(".why .choice");
const mission = (page, name) => page.locator(".head select").first().selectOption({ label: name });
const shoot = (page, name) => page.screenshot({ path: join(pictures, `${name}.png`) });

async function seek(page, seconds) {
  await page.locator(".slider").evaluate((slider, t_us) => {
    slider.value = String(t_us);
    slider.dispatchEvent(new Event("input", { bubbles: true }));
  }, seconds * 1e6);
}

async function seriousFindings(page) {
  await page.evaluate(axe);
  const found = await page.evaluate(() => globalThis.axe.run(document));
  const serious = found.violations.filter((it) => it.impact === "serious" || it.impact === "critical");
  return serious.map((it) => `${it.id}: ${it.nodes.slice(0, 3).map((node) => node.target.join(" ") + " " + (node.any[0]?.message ?? "")).join("; ")}`);
}

/** What a person does in one page, from the tour on. */
async function onePage({ check, open }) {
  const page = await open();

  await check("the tour has six steps, and the file that was named is open", async () => {
    assert.equal(await page.locator(".text h2").textContent(), "3_gap.esm");
    await shoot(page, "tour");
    for (let step = 1; step < 6; step++) {
      assert.match(await page.locator(".tour h2").textContent(), new RegExp(`^${step}/6`));
      await page.click(".tour button.main");
    }
    await page.keyboard.press("Escape");
    assert.equal(await page.locator(".tour").count(), 0);
    await mission(page, "patrol");
    await page.waitForFunction(() => document.querySelector(".text h2").textContent === "patrol.esm");
    await page.waitForSelector('.sheet g[data-path="motion/Roam"]');
  });

  await check("a mistake is marked as it is written, the picture stays grey, and a fix cures it", async () => {
    await page.click(".cm-content");
    await page.keyboard.press("Control+Home");
    await page.keyboard.insertText("interpreter slto 1;\n");
    await page.waitForSelector(".problems li.error");
    await page.waitForSelector(".sheet.stale svg");
    await shoot(page, "problem");
    await page.keyboard.press("Control+z");
    await page.waitForFunction(() => document.querySelectorAll(".problems li.error").length === 0);
    await page.waitForSelector(".sheet:not(.stale) svg");
    // A name that is nearly right has a fix.
    await page.keyboard.press("Control+End");
    await page.keyboard.insertText("\ncontainer Extra { region r { state Here; initial -> Hree; } }");
    await page.waitForSelector(".problems button.fix");
    await page.locator(".problems button.fix", { hasText: "write `Here`" }).click();
    await page.waitForFunction(() => document.querySelectorAll(".problems li.error").length === 0);
  });

  await check("names are completed, explained and found, and the text is laid out", async () => {
    await page.locator(".text button", { hasText: "Undo changes" }).click();
    await page.click(".cm-content");
    await page.keyboard.press("Control+Home");
    await page.keyboard.type("sl");
    await page.keyboard.press("Control+Space");
    await page.waitForSelector(".cm-tooltip-autocomplete li");
    await page.keyboard.press("Escape");
    await page.locator(".text button", { hasText: "Undo changes" }).click();
    await page.waitForFunction(() => !document.querySelector(".cm-content").textContent.startsWith("sl//"));
    await page.locator(".cm-line", { hasText: "Retreat: Back" }).first().locator("span", { hasText: "Retreat" }).hover();
    await page.waitForSelector(".cm-tooltip-hover, .cm-tooltip .cm-lsp-hover-tooltip, .cm-tooltip");
  });

  await check("a state in the diagram leads to its line, and back", async () => {
    await page.locator('.sheet g.state[data-path="motion/Roam/steps/Ahead"] text').first().click();
    await page.waitForFunction(() => document.querySelector(".cm-activeLine")?.textContent.includes("Ahead"));
    await page.waitForSelector('.sheet g.cursor[data-path="motion/Roam/steps/Ahead"]');
  });

  await check("the robot drives, by keyboard, and its trace is the command's", async () => {
    await page.keyboard.press("Control+Enter");
    await at(page, 1);
    await page.waitForSelector('.sheet g.lit[data-path="motion/Roam"]');
    await whole(page);
    const label = await page.locator(".robot canvas").getAttribute("aria-label");
    await at(page, 4);
    assert.notEqual(await page.locator(".robot canvas").getAttribute("aria-label"), label, "the robot has moved");
    await page.keyboard.press("Alt+Enter");
    await shoot(page, "run");
  });

  await check("any moment can be gone to, forwards and backwards, step by step", async () => {
    await seek(page, 30);
    assert.equal(await clock(page), 30);
    await page.waitForFunction(() => document.querySelector(".why .facts").textContent.includes("30.00"));
    await page.keyboard.press("Alt+ArrowRight");
    assert.equal(await clock(page), 30.02);
    await page.keyboard.press("Alt+ArrowLeft");
    await page.keyboard.press("Alt+ArrowLeft");
    assert.equal(await clock(page), 29.98);
    await seek(page, 5);
    await page.waitForFunction(() => document.querySelector(".why .facts").textContent.includes("5.00"));
    assert.ok((await page.locator(".why .term").count()) > 3);
  });

  await check("a breakpoint pauses the run where its state is entered", async () => {
    await seek(page, 0);
    await page.locator('.sheet g.state[data-path="motion/Roam/steps/AvoidRight"]').first().focus();
    await page.keyboard.press("b");
    await page.waitForSelector('.sheet g.breaks[data-path="motion/Roam/steps/AvoidRight"]');
    await page.locator(".speed select").selectOption("16");
    await page.keyboard.press("Alt+Enter");
    await page.waitForSelector('.sheet g.lit[data-path="motion/Roam/steps/AvoidRight"]');
    await page.waitForFunction(() => document.querySelector(".time .note").textContent.includes("AvoidRight"));
    await page.waitForSelector(".why .choice.taken");
    await shoot(page, "breakpoint");
  });

  await check("a transition that was not taken says which term was missing, and since when", async () => {
    await page.locator('.sheet g.state[data-path="motion/Roam/steps/AvoidRight"]').first().focus();
    await page.keyboard.press("b");
    await seek(page, 13);
    await page.locator(".why .arrow", { hasText: "Ahead → AvoidLeft" }).click();
    const asked = page.locator(".why .asked");
    await asked.locator(".lacks", { hasText: "Missing: .near true" }).waitFor();
    const since = await asked.locator("li", { hasText: ".near" }).locator(".since").textContent();
    const [, seconds, step] = since.match(/since ([0-9.]+) s, macro step (\d+)/);
    // Before that it was another one, or the state was not current.
    assert.ok(Number(seconds) < 13 && Math.abs(Number(step) * 0.02 - Number(seconds)) < 0.011);
    await asked.locator("li", { hasText: ".near" }).locator(".since").click();
    assert.equal(await clock(page), Number(seconds));
    await shoot(page, "why-not");
    // Of a state that is not current, that is why.
    await seek(page, 13);
    await page.locator(".why .asked .close").click();
    await page.locator('.sheet g.transition[data-path="motion/Roam/steps/Look"]').first().focus();
    await page.keyboard.press("Enter");
    await asked.locator(".reason", { hasText: "Look is not current" }).waitFor();
    await page.locator(".why .asked .close").click();
  });

  await check("a transition, a term and a value beyond a limit pause the run, each where it comes first", async () => {
    const paused = async (pattern) => {
      await seek(page, 0.5);
      await page.keyboard.press("Alt+Enter");
      await note(page, pattern);
      return clock(page);
    };
    await seek(page, 13);
    const row = page.locator(".why .choice", { hasText: "Ahead → AvoidLeft" }).first();
    await row.locator(".dot").click();
    const taken = await paused(/Ahead → AvoidLeft is taken/);
    await page.waitForSelector(".why .choice.taken");
    assert.match(await page.locator(".why .choice.taken .arrow").allTextContents().then((all) => all.join()), /Ahead → AvoidLeft/);
    await page.locator(".breaks button").click();
    await seek(page, 13);
    await row.locator(".term", { hasText: ".near" }).click();
    const near = await paused(/\.near becomes true/);
    assert.ok(near <= taken, `${near} ${taken}`);
    assert.equal(await page.locator(".why .choice", { hasText: "Ahead → AvoidLeft" }).first().locator(".term.true", { hasText: ".near" }).count(), 1);
    await page.locator(".breaks button").click();
    await page.locator(".time button", { hasText: "Values" }).click();
    await page.locator(".curves input[type=search]").fill("forward");
    await page.locator(".curves li input").first().check();
    await page.locator(".curves input[type=text]").fill("0");
    await page.locator(".curves button", { hasText: "is below" }).click();
    const back = await paused(/forward < 0/);
    assert.ok(back > near, "it drives backwards when something was near");
    await page.locator(".breaks button").click();
  });

  await check("numbers, slots and events are shown over time", async () => {
    await page.locator(".curves input[type=search]").fill("battery");
    await page.locator(".curves li input").first().check();
    await page.locator(".time button", { hasText: "Slots" }).click();
    await page.locator(".time button", { hasText: "Events" }).click();
    await page.waitForSelector(".events li.transition");
    await page.waitForFunction(() => /slot 2.*wheels\/Drive/.test(document.querySelector(".lanes + .lanes canvas").getAttribute("aria-label")));
    assert.ok(await page.locator(".events li.log").count() > 0);
    const drawn = await page.locator(".lanes canvas").first().evaluate((canvas) => {
      // The last row of numbers lies above the axis: it has the curve's colour somewhere.
      const ratio = devicePixelRatio;
      const box = canvas.getContext("2d").getImageData(140 * ratio, canvas.height - 70 * ratio, canvas.width - 160 * ratio, 46 * ratio).data;
      let pixels = 0;
      for (let at = 0; at < box.length; at += 4) if (box[at] > 140 && box[at + 1] < 120 && box[at + 2] < 60) pixels += 1;
      return pixels;
    });
    assert.ok(drawn > 100, `${drawn} dots of a curve`);
    await shoot(page, "values");
    assert.deepEqual(await seriousFindings(page), []);
    const first = page.locator(".events li button").first();
    const there = Number.parseFloat(await first.textContent());
    await first.click();
    assert.equal(await clock(page), there);
    for (const name of ["Values", "Slots", "Events"]) await page.locator(".time button", { hasText: name }).click();
  });

  await check("a person, a dead sonar and the emergency stop change the run from here on", async () => {
    const before = await page.locator(".robot .facts").textContent();
    await page.locator(".hands button", { hasText: "Person ahead" }).click();
    await page.locator(".hands select").selectOption("sonar 0");
    await whole(page);
    assert.equal(await page.locator(".hands .done li").count(), 2);
    await page.waitForFunction((before) => document.querySelector(".robot .facts").textContent !== before, before);
    await page.locator(".hands button", { hasText: "Emergency stop" }).click();
    await page.waitForFunction(() => document.querySelectorAll(".hands .done li").length === 3);
    await shoot(page, "hands");
    await page.locator(".hands button", { hasText: "Clear" }).click();
    await page.waitForFunction(() => document.querySelectorAll(".hands .done li").length === 0);
  });

  await check("a wall is drawn with the mouse, a wheel is stopped, and a bookmark holds all of it", async () => {
    await whole(page);
    await seek(page, 3);
    const before = await page.locator(".robot .facts").textContent();
    await page.locator(".hands button", { hasText: "Draw a wall" }).click();
    const box = await page.locator(".robot canvas").boundingBox();
    await page.mouse.move(box.x + box.width * 0.3, box.y + box.height * 0.5);
    await page.mouse.down();
    await page.mouse.move(box.x + box.width * 0.4, box.y + box.height * 0.55, { steps: 4 });
    await page.mouse.up();
    await page.locator(".hands .done li", { hasText: /wall .* 3\.00 s/ }).waitFor();
    await page.locator(".hands button", { hasText: "Wall ahead" }).click();
    await page.locator(".hands select").selectOption("wheel left");
    await page.waitForFunction(() => document.querySelectorAll(".hands .done li").length === 3);
    await whole(page);
    await page.waitForFunction((before) => document.querySelector(".robot .facts").textContent !== before, before);
    await seek(page, 8);
    await shoot(page, "wall");
    await page.locator(".head button", { hasText: "Copy link" }).click();
    await page.waitForFunction(() => location.hash.startsWith("#m="));
    const place = await page.locator(".robot canvas").getAttribute("aria-label");
    const other = await open({}, page.url());
    await other.waitForFunction(() => Number.parseFloat(document.querySelector(".clock").textContent) === 8);
    assert.equal(await other.locator(".hands .done li").count(), 3);
    await other.waitForFunction((place) => document.querySelector(".robot canvas").getAttribute("aria-label") === place, place);
    await other.context().close();
    await page.locator(".hands button", { hasText: "Clear" }).click();
  });

  await check("states are searched, folded, zoomed and dragged", async () => {
    await page.locator(".diagram input[type=search]").fill("avoid");
    await page.waitForFunction(() => {
      const count = document.querySelectorAll(".sheet g.state.found").length;
      return count > 3 && document.querySelector(".diagram .facts")?.textContent === `${count} states`;
    });
    await page.locator(".diagram input[type=search]").press("Enter");
    await page.waitForSelector(".sheet g.found.here");
    await page.locator(".diagram input[type=search]").fill("");
    await page.locator(".diagram select").selectOption("0");
    await page.waitForFunction(() => !document.querySelector('.sheet g[data-path="motion/Roam/steps/Ahead"]'));
    await page.locator(".diagram select").selectOption("1");
    await page.waitForSelector('.sheet g[data-path="motion/Roam/steps/Ahead"]');
    await page.locator(".diagram select").selectOption("null");
    await page.waitForSelector('.sheet g[data-path="motion/Roam/steps/AvoidLeft/steps/Retreat"]');
    const width = () => page.locator(".sheet svg").evaluate((svg) => svg.getBoundingClientRect().width);
    const fitted = await width();
    await page.locator(".diagram .sheet").focus();
    for (let press = 0; press < 5; press++) await page.keyboard.press("+");
    await page.waitForFunction((fitted) => document.querySelector(".sheet svg").getBoundingClientRect().width > 2 * fitted, fitted);
    const box = await page.locator(".diagram .sheet").boundingBox();
    await page.mouse.move(box.x + 200, box.y + 80);
    await page.mouse.down();
    await page.mouse.move(box.x + 60, box.y + 60, { steps: 5 });
    await page.mouse.up();
    await page.waitForFunction(() => document.querySelector(".diagram .sheet").scrollLeft >= 130);
    await page.keyboard.press("0");
    // One superstate by itself, with the mouse and by keyboard.
    const avoid = "motion/Roam/steps/AvoidLeft";
    const states = await page.locator(".sheet g.state").count();
    await page.locator(`.sheet g.state.open[data-path="${avoid}"] .fold`).click();
    await page.waitForSelector(`.sheet g.state.folded[data-path="${avoid}"]`);
    assert.equal(await page.locator(`.sheet g.state[data-path^="${avoid}/"]`).count(), 0);
    assert.ok(await page.locator('.sheet g.state[data-path^="motion/Roam/steps/AvoidRight/"]').count() > 0);
    await page.locator(`.sheet g.state[data-path="${avoid}"]`).focus();
    await page.keyboard.press("f");
    await page.waitForSelector(`.sheet g.state.open[data-path="${avoid}"]`);
    assert.equal(await page.locator(".sheet g.state").count(), states);
    assert.equal(await page.evaluate(() => document.activeElement.dataset.path), avoid);
    // And one alone is opened where others are folded.
    await page.locator(".diagram select").selectOption("0");
    await page.locator('.sheet g.state.folded[data-path="motion/Roam"]').focus();
    await page.keyboard.press("f");
    await page.waitForSelector('.sheet g.state.folded[data-path="motion/Roam/steps/AvoidLeft"]');
    await page.locator(".diagram select").selectOption("null");
    await page.waitForSelector(`.sheet g.state[data-path="${avoid}/steps/Retreat"]`);
  });

  await check("a change of the text takes over at this moment, warm", async () => {
    // Behind what is worked out there is nothing to go to yet.
    await whole(page);
    await seek(page, 4);
    await page.locator(".cm-content").press("Control+Home");
    await page.keyboard.type("// changed\n");
    await page.waitForSelector(".outdated button:not(:disabled)");
    await page.click(".outdated button");
    await page.waitForFunction(() => /Taken over at 4\.00 s: [1-9]/.test(document.querySelector(".time .note").textContent));
  });

  await check("what was written stays, and a link holds it", async () => {
    const before = page.url();
    await page.locator(".head button", { hasText: "Copy link" }).click();
    await page.waitForFunction((before) => location.href !== before && location.hash.startsWith("#m="), before);
    const link = page.url();
    const other = await open();
    await other.goto("about:blank");
    await other.goto(link);
    await other.waitForSelector(".sheet svg");
    await other.waitForFunction(() => document.querySelector(".cm-content").textContent.startsWith("// changed"));
    await other.context().close();
    await page.goto(address);
    await page.waitForSelector(".sheet svg");
    await mission(page, "patrol *");
    await page.waitForFunction(() => document.querySelector(".cm-content").textContent.startsWith("// changed"));
    await page.locator(".text button", { hasText: "Undo changes" }).click();
  });

  await check("a recording that is dropped onto the page is replayed, guards and all", async () => {
    const recording = join(pictures, "patrol.rec");
    // What a robot did is not overwritten.
    rmSync(recording, { force: true });
    execFileSync(esm, ["run", "missions/patrol.esm", "--board", "host", "--until", "30 s", "--record", recording], { cwd: root, stdio: "ignore" });
    const bytes = [...readFileSync(recording)];
    await page.locator("body").evaluate((body, bytes) => {
      const dropped = new DataTransfer();
      dropped.items.add(new File([new Uint8Array(bytes)], "patrol.rec"));
      body.dispatchEvent(new DragEvent("drop", { dataTransfer: dropped, bubbles: true, cancelable: true }));
    }, bytes);
    await note(page, /A recording/);
    assert.equal(await page.locator(".text h2").textContent(), "patrol.esm");
    const replayed = execFileSync(esm, ["replay", recording, "--step"], { cwd: root, input: "t 15 s\nq\n", encoding: "utf8" });
    const [, seconds, step, from, to] = replayed.match(/([0-9.]+) s, patrol: macro step (\d+),.*\n\s+(\S+) -> (\S+)/);
    await seek(page, Number(seconds));
    await page.waitForFunction((step) => document.querySelector(".why .facts")?.textContent.startsWith(`macro step ${step} `), step);
    const arrow = [from, to].map((path) => path.split("/").pop()).join(" → ");
    await page.locator(".why .choice.taken", { hasText: arrow }).first().waitFor();
    await page.waitForSelector(`.sheet g.transition.taken[data-path="${from}"]`, { state: "attached" });
    await page.locator(".time button", { hasText: "Values" }).click();
    await page.locator(".curves li", { hasText: "pose x" }).waitFor();
    await page.locator(".time button", { hasText: "Values" }).click();
    await shoot(page, "recording");
    // What is no recording does no harm.
    await page.locator("body").evaluate((body) => {
      const dropped = new DataTransfer();
      dropped.items.add(new File(["ESMREC nothing"], "broken.rec"));
      body.dispatchEvent(new DragEvent("drop", { dataTransfer: dropped, bubbles: true, cancelable: true }));
    });
    await page.waitForSelector(".time .note .error");
    await page.keyboard.press("Control+Enter");
    await whole(page);
  });

  await check("another language, light and dark, and nothing serious for who cannot see", async () => {
    assert.deepEqual(await seriousFindings(page), []);
    await page.keyboard.press("Control+Enter");
    await whole(page);
    await page.keyboard.press("Alt+Enter");
    assert.deepEqual(await seriousFindings(page), []);
    const dark = await page.locator(".head button", { hasText: "◐" });
    await dark.click();
    await page.locator(".time button", { hasText: "Values" }).click();
    await page.locator(".time button", { hasText: "Slots" }).click();
    await page.waitForSelector(".curves li");
    await shoot(page, "dark");
    assert.deepEqual(await seriousFindings(page), []);
    await page.locator(".head select").last().selectOption("de");
    assert.equal(await page.locator(".robot h2").textContent(), "Roboter");
    await page.locator(".head select").last().selectOption("en");
  });
}

/** What has pages of its own. */
async function besides({ check, open, errors }) {
  await check("a panic in the engine loses no text, and another one is started", async () => {
    // The test's own words behind the worker's: they keep the instance, so that it can be damaged.
    const exposed = await open({}, `${address}#open=patrol`, async (route) => {
      const answer = await route.fetch();
      const hook = "const own = WebAssembly.instantiate; WebAssembly.instantiate = async (...words) => (self.held = await own(...words));\n";
      await route.fulfill({ response: answer, body: hook + (await answer.text()) });
    });
    await whole(exposed);
    await exposed.locator(".cm-content").press("Control+Home");
    await exposed.keyboard.type("// kept\n");
    await exposed.waitForFunction(() => document.querySelector(".cm-content").textContent.startsWith("// kept"));
    const desk = exposed.workers()[0];
    await desk.evaluate(() => {
      const { memory } = self.held.exports;
      new Uint8Array(memory.buffer).fill(0xff);
    });
    await exposed.locator(".cm-content").press("Control+Home");
    await exposed.keyboard.type("// more\n");
    await exposed.locator(".message", { hasText: "was started again" }).waitFor();
    assert.match(await exposed.locator(".cm-content").textContent(), /^\/\/ more\/\/ kept/);
    // The new one draws, checks and runs.
    await exposed.locator(".message button").click();
    await exposed.locator(".cm-content").press("Control+Home");
    await exposed.keyboard.insertText("interpreter slto 1;\n");
    await exposed.waitForSelector(".problems li.error");
    await exposed.keyboard.press("Control+z");
    await exposed.waitForFunction(() => document.querySelectorAll(".problems li.error").length === 0);
    await exposed.waitForSelector(".sheet:not(.stale) svg");
    await exposed.keyboard.press("Control+Enter");
    await whole(exposed);
    await exposed.context().close();
  });

  await check("links of the book open each step of the tutorial, and drive it", async () => {
    const book = readFileSync(join(root, "docs/src/tutorial.md"), "utf8");
    const links = [...book.matchAll(/\(..\/..\/(studio\/dist\/index\.html#open=[^)\s]+)\)/g)].map((it) => it[1]);
    assert.equal(new Set(links).size, 6, "a link for each step");
    // Any server of files, as in the checkout.
    const kinds = { html: "text/html", js: "text/javascript", css: "text/css" };
    const files = createServer((request, answer) => {
      const path = join(root, decodeURIComponent(new URL(request.url, "http://here").pathname));
      if (!existsSync(path)) answer.writeHead(404).end();
      else answer.writeHead(200, { "Content-Type": kinds[path.split(".").pop()] ?? "text/plain" }).end(readFileSync(path));
    }).listen(0, "127.0.0.1");
    await new Promise((done) => files.once("listening", done));
    const here = `http://127.0.0.1:${files.address().port}/`;
    for (const [number, link] of links.entries()) {
      // The browser says of each file that is not there that it is not.
      const before = errors.length;
      const step = await open({}, here + link);
      errors.splice(before, Infinity, ...errors.slice(before).filter((text) => !text.includes("404")));
      assert.match(await step.locator(".text h2").textContent(), new RegExp(`^${number + 1}_.*\\.esm$`));
      await step.locator(".why .facts", { hasText: "macro step" }).waitFor();
      assert.equal(await step.locator(".time .note .error").count(), 0);
      await step.context().close();
    }
    files.close();
    // In the page of the command they are followed without loading it anew.
    const step = await open({}, `${address}#open=tutorial/1_line&world=track`);
    await step.locator(".why .facts", { hasText: "macro step" }).waitFor();
    await step.evaluate(() => { location.hash = "#open=tutorial/4_search&world=track"; });
    await step.waitForFunction(() => document.querySelector(".text h2").textContent === "4_search.esm");
    await whole(step);
    await step.context().close();
  });

  await check("a phone shows one part at a time", async () => {
    const phone = await open({ viewport: { width: 390, height: 844 }, colorScheme: "dark" });
    await phone.locator(".tour button", { hasText: "Close" }).click();
    for (const [tab, panel] of [["Diagram", "diagram"], ["Robot", "robot"], ["Why", "why"], ["Text", "text"]]) {
      await phone.locator(".tabs button", { hasText: tab }).click();
      assert.ok(await phone.locator(`.panel.${panel}`).isVisible());
      await shoot(phone, `phone-${panel}`);
    }
    const wide = await phone.evaluate(() => document.documentElement.scrollWidth > innerWidth);
    assert.equal(wide, false, "nothing is wider than the screen");
    await phone.context().close();
  });

  await check("who has no token gets nothing", async () => {
    const port = new URL(address).port;
    for (const path of ["/", "/studio.js", "/files.json"]) {
      assert.equal((await fetch(`http://127.0.0.1:${port}${path}`)).status, 403);
    }
    assert.equal((await fetch(address, { method: "POST" })).status, 405);
    assert.equal((await fetch(address, { headers: { Origin: "http://evil.example" } })).status, 403);
    assert.equal((await fetch(`${address}nothing`)).status, 404);
  });
}

/** A robot in real time: nothing else takes its processor. */
async function aRobot({ check, open }) {
  await check("a robot that is connected is seen live, and misses no slot for it", async () => {
    const board = await started(["board", "--board", "host"], (line) => line.match(/^the robot is at ([^;]+);/)[1]);
    const port = board.said;
    try {
      execFileSync(esm, ["upload", "missions/patrol.esm", "--port", port], { cwd: root, stdio: "ignore" });
      const live = await started(["studio", "--json", "--port", port], (line) => JSON.parse(line).address);
      const watched = await open({}, live.said);
      await note(watched, /Connected to a robot/);
      await watched.waitForSelector('.sheet g.lit[data-path="motion/Roam"]', { state: "attached" });
      assert.equal(await watched.locator(".text h2").textContent(), "patrol.esm");
      await whole(watched);
      const first = await clock(watched);
      await at(watched, first + 2);
      await watched.locator(".time button", { hasText: "Slots" }).click();
      await watched.locator(".time button", { hasText: "Values" }).click();
      await watched.locator(".curves li", { hasText: "pose x" }).locator("input").check();
      await watched.locator(".time button", { hasText: "Events" }).click();
      await watched.waitForSelector(".events li.transition", { timeout: 20_000 });
    await watched.waitForSelector(".events li.log", { timeout: 20_000 });
      await shoot(watched, "live");
      assert.deepEqual(await seriousFindings(watched), []);
      // It can be stopped at a moment, and looked at, while the robot goes on.
      await watched.keyboard.press("Alt+Enter");
      const stopped = await clock(watched);
      await watched.waitForTimeout(400);
      assert.equal(await clock(watched), stopped);
      await watched.keyboard.press("Alt+Enter");
      await at(watched, stopped + 0.3);
      // Whatever the page asks for: nothing of that costs the robot a slot.
      await watched.evaluate(() => Promise.all(Array.from({ length: 40 }, (_, n) => fetch(`live?from=${n * 1e9}&seen=x`))));
      await watched.context().close();
      live.child.kill("SIGINT");
      assert.equal(await new Promise((done) => live.child.once("exit", done)), 0);
      const status = JSON.parse(execFileSync(esm, ["status", "--port", port, "--json"], { cwd: root, encoding: "utf8" }));
      assert.ok(status.slots.every((slot) => slot.missed === 0), JSON.stringify(status.slots));
    } finally {
      board.child.kill("SIGINT");
    }
  });
}

await Promise.all([onePage(lane()), besides(lane())]);
await aRobot(lane());

await browser.close();
server.kill("SIGINT");
const status = await new Promise((done) => server.once("exit", done));
assert.equal(status, 0, "Ctrl-C ends the command in order");
console.log(`${passed} passed, ${failed} failed`);
process.exit(failed === 0 ? 0 : 1);
