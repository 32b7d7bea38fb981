// A robot whose line has the speed of a real one, as a test or a measurement needs it.
import { openSync, writeSync } from "node:fs";
import { createServer } from "node:net";
import { ReadStream } from "node:tty";

/** Bits of a byte on a serial line, with start and stop. */
const BITS_PER_BYTE = 10;

/** Passes bytes on as a line of that speed does, none earlier than the one before it is through. */
function paced(baud, write) {
  let free_ms = performance.now();
  return (bytes) => {
    const now_ms = performance.now();
    free_ms = Math.max(free_ms, now_ms) + (bytes.length * BITS_PER_BYTE * 1000) / baud;
    setTimeout(() => write(bytes), free_ms - now_ms);
  };
}

/** Stands between a robot's port and one client, at that speed both ways; answers where. */
export async function lineOf(port, baud) {
  const robot = openSync(port, "r+");
  const from_robot = new ReadStream(robot);
  from_robot.setRawMode(true);
  let client = null;
  const out = paced(baud, (bytes) => client?.write(bytes));
  const into = paced(baud, (bytes) => writeSync(robot, bytes));
  from_robot.on("data", out);
  const server = createServer((socket) => {
    client = socket;
    socket.setNoDelay(true);
    socket.on("data", into);
    socket.on("error", () => {});
  }).listen(0, "127.0.0.1");
  await new Promise((done) => server.once("listening", done));
  return {
    port: `tcp:127.0.0.1:${server.address().port}`,
    close() {
      client?.destroy();
      server.close();
      from_robot.destroy();
    },
  };
}
