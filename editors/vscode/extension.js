// Starts `esm lsp` for .esm files, and stops it with the editor.

const { workspace } = require("vscode");
const { LanguageClient, TransportKind } = require("vscode-languageclient/node");

/** @type {LanguageClient | undefined} */
let client;

function activate() {
  const command = workspace.getConfiguration("esm").get("command", "esm");
  const server = { command, args: ["lsp"], transport: TransportKind.stdio };
  client = new LanguageClient("esm", "ESM", server, {
    documentSelector: [{ language: "esm" }],
    synchronize: { fileEvents: workspace.createFileSystemWatcher("**/*.esm") },
  });
  return client.start();
}

function deactivate() {
  return client?.stop();
}

module.exports = { activate, deactivate };
