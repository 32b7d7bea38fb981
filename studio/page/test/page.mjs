// Drives the page in a browser: `node test/page.mjs ESM ROOT PICTURES`. The command serves it.
import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { existsSync, mkdirSync, readFileSync } from "node:fs";
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
const errors = [];

async function check(name, run) {
  const before = errors.length;
  try {
    await run();
    assert.deepEqual(errors.slice(before), []);
    passed += 1;
  } catch (error) {
    failed += 1;
    console.error(`FAILED ${name}: ${String(error.stack ?? error).slice(0, 1500)}`);
  }
}

async function open(options = {}) {
  const context = await browser.newContext({ viewport: { width: 1440, height: 900 }, ...options });
  const page = await context.newPage();
  page.setDefaultTimeout(30_000);
  page.on("console", (message) => {
    if (message.type() === "error") errors.push(message.text());
  });
  page.on("pageerror", (error) => errors.push(error.message));
  await page.goto(address);
  await page.waitForSelector(".sheet svg", { state: "attached" });
  return page;
}

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

await check("a person, a dead sonar and the emergency stop change the run from here on", async () => {
  const before = await page.locator(".robot .facts").textContent();
  await page.locator(".hands button", { hasText: "Person ahead" }).click();
  await page.locator(".hands select").selectOption("0");
  await whole(page);
  assert.equal(await page.locator(".hands .done li").count(), 2);
  await page.waitForFunction((before) => document.querySelector(".robot .facts").textContent !== before, before);
  await page.locator(".hands button", { hasText: "Emergency stop" }).click();
  await page.waitForFunction(() => document.querySelectorAll(".hands .done li").length === 3);
  await shoot(page, "hands");
  await page.locator(".hands button", { hasText: "Clear" }).click();
  await page.waitForFunction(() => document.querySelectorAll(".hands .done li").length === 0);
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
  await page.locator(".head button", { hasText: "Copy link" }).click();
  await page.waitForFunction(() => location.hash.startsWith("#m="));
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

await check("another language, light and dark, and nothing serious for who cannot see", async () => {
  assert.deepEqual(await seriousFindings(page), []);
  await page.keyboard.press("Control+Enter");
  await whole(page);
  await page.keyboard.press("Alt+Enter");
  assert.deepEqual(await seriousFindings(page), []);
  const dark = await page.locator(".head button", { hasText: "◐" });
  await dark.click();
  await shoot(page, "dark");
  assert.deepEqual(await seriousFindings(page), []);
  await page.locator(".head select").last().selectOption("de");
  assert.equal(await page.locator(".robot h2").textContent(), "Roboter");
  await page.locator(".head select").last().selectOption("en");
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

await browser.close();
server.kill("SIGINT");
const status = await new Promise((done) => server.once("exit", done));
assert.equal(status, 0, "Ctrl-C ends the command in order");
console.log(`${passed} passed, ${failed} failed`);
process.exit(failed === 0 ? 0 : 1);
