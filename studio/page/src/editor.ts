/** The editor: CodeMirror with the project's own language server behind it. */
import { autocompletion, closeBrackets, closeBracketsKeymap, completionKeymap } from "@codemirror/autocomplete";
import { defaultKeymap, history, historyKeymap, indentWithTab, temporarilySetTabFocusMode } from "@codemirror/commands";
import { bracketMatching, HighlightStyle, indentOnInput, StreamLanguage, syntaxHighlighting } from "@codemirror/language";
import { lintGutter, lintKeymap, setDiagnostics } from "@codemirror/lint";
import {
  formatDocument, formatKeymap, hoverTooltips, jumpToDefinitionKeymap, LSPClient, LSPPlugin, renameKeymap,
  serverCompletion, Workspace, type Transport, type WorkspaceFile,
} from "@codemirror/lsp-client";
import { EditorState, type Text } from "@codemirror/state";
import {
  drawSelection, EditorView, highlightActiveLine, highlightActiveLineGutter, keymap, lineNumbers,
} from "@codemirror/view";
import { tags } from "@lezer/highlight";
import { type Engine, Refused } from "./engine";
import type { Diagnostic } from "./protocol";

const TYPES = new Set(["bool", "i32", "u32", "f32"]);
const DECLARE = new Set([
  "machine", "container", "region", "state", "task", "super", "slot", "event", "flag", "data", "param", "path",
  "interpreter", "queue", "use",
]);
const WORDS = new Set([
  "in", "out", "inout", "on", "send", "set", "clear", "not", "and", "or", "exit", "timeout", "busy", "initial",
  "final", "period", "duration", "wcet", "exclusive", "endless", "count", "optional", "within", "with", "true", "false",
]);

const language = StreamLanguage.define<{ comment: boolean }>({
  name: "esm",
  startState: () => ({ comment: false }),
  token(stream, state) {
    if (state.comment) {
      if (stream.skipTo("*/")) {
        stream.match("*/");
        state.comment = false;
      } else stream.skipToEnd();
      return "comment";
    }
    if (stream.eatSpace()) return null;
    if (stream.match("///")) {
      stream.skipToEnd();
      return "docComment";
    }
    if (stream.match("//")) {
      stream.skipToEnd();
      return "comment";
    }
    if (stream.match("/*")) {
      state.comment = true;
      return "comment";
    }
    if (stream.match(/^"[^"]*"?/)) return "string";
    if (stream.match(/^[.^][A-Za-z_]\w*/)) return "propertyName";
    if (stream.match(/^-?\d+(\.\d+)?(e-?\d+)?/)) return "number";
    const word = stream.match(/^[A-Za-z_]\w*/);
    if (word) {
      const text = Array.isArray(word) ? word[0] : "";
      if (TYPES.has(text)) return "typeName";
      if (DECLARE.has(text)) return "definitionKeyword";
      if (WORDS.has(text)) return "keyword";
      return /^[A-Z]/.test(text) ? "className" : null;
    }
    if (stream.match("->")) return "operator";
    stream.next();
    return null;
  },
  languageData: { commentTokens: { line: "//", block: { open: "/*", close: "*/" } } },
});

const colours = HighlightStyle.define([
  { tag: tags.comment, color: "var(--text-comment)", fontStyle: "italic" },
  { tag: tags.docComment, color: "var(--text-doc)" },
  { tag: tags.string, color: "var(--text-string)" },
  { tag: tags.number, color: "var(--text-number)" },
  { tag: [tags.keyword, tags.definitionKeyword], color: "var(--text-keyword)", fontWeight: "600" },
  { tag: tags.typeName, color: "var(--text-type)" },
  { tag: tags.className, color: "var(--text-name)" },
  { tag: tags.propertyName, color: "var(--text-flag)" },
  { tag: tags.operator, color: "var(--text-keyword)" },
]);

/** A message of the language server's protocol. */
type Message = Record<string, unknown> & { method?: string; params?: Record<string, unknown> };

/** Messages to the engine and from it; those that come while it works go together. */
class Line implements Transport {
  private handlers = new Set<(value: string) => void>();
  private waiting: Message[] = [];
  private isBusy = false;

  constructor(private engine: Engine, private heard: (message: Message) => void) {}

  send(message: string): void {
    this.waiting.push(JSON.parse(message));
    void this.work();
  }

  private async work(): Promise<void> {
    if (this.isBusy) return;
    this.isBusy = true;
    while (this.waiting.length > 0) {
      const messages = this.waiting.splice(0);
      try {
        const answer = await this.engine.call<{ messages: Message[] }>({ call: "serve", messages });
        for (const message of answer.messages) {
          this.heard(message);
          // A file that nobody has open needs no view.
          if (message.method === "textDocument/publishDiagnostics") continue;
          for (const handler of this.handlers) handler(JSON.stringify(message));
        }
      } catch (error) {
        // Whoever has the engine is told, and connects again.
        if (!(error instanceof Refused)) throw error;
      }
    }
    this.isBusy = false;
  }

  subscribe(handler: (value: string) => void): void {
    this.handlers.add(handler);
  }

  unsubscribe(handler: (value: string) => void): void {
    this.handlers.delete(handler);
  }
}

class OpenFile implements WorkspaceFile {
  constructor(
    public uri: string, public languageId: string, public version: number, public doc: Text, public view: EditorView,
  ) {}
  getView(): EditorView {
    return this.view;
  }
}

/** The one file that is open; others are the engine's own. */
class OneFile extends Workspace {
  files: OpenFile[] = [];
  private version = 0;
  show: (uri: string) => EditorView | null = () => null;

  syncFiles() {
    const changed = [];
    for (const file of this.files) {
      const plugin = LSPPlugin.get(file.view);
      if (!plugin || plugin.unsyncedChanges.empty) continue;
      changed.push({ changes: plugin.unsyncedChanges, file, prevDoc: file.doc });
      file.doc = file.view.state.doc;
      file.version = ++this.version;
      plugin.clear();
    }
    return changed;
  }

  openFile(uri: string, languageId: string, view: EditorView): void {
    this.files = this.files.filter((file) => file.uri !== uri);
    const file = new OpenFile(uri, languageId, ++this.version, view.state.doc, view);
    this.files.push(file);
    this.client.didOpen(file);
  }

  closeFile(uri: string): void {
    if (!this.files.some((file) => file.uri === uri)) return;
    this.files = this.files.filter((file) => file.uri !== uri);
    this.client.didClose(uri);
  }

  async displayFile(uri: string): Promise<EditorView | null> {
    return this.files.find((file) => file.uri === uri)?.view ?? this.show(uri);
  }
}

/** A diagnostic, with the fixes that there are. */
export interface Problem extends Diagnostic {
  fixes: { title: string; edits: { range: Diagnostic["range"]; newText: string }[] }[];
}

export interface Hooks {
  changed(text: string): void;
  moved(offset: number): void;
  problems(problems: Problem[]): void;
  /** Another file is to be shown. */
  show(path: string): void;
}

export const uriOf = (path: string) => "file://" + path;

/** The editor in the page. */
export class Editor {
  readonly view: EditorView;
  private client: LSPClient;
  private line: Line;
  private path = "";
  private workspace!: OneFile;
  private pending = 0;

  constructor(private engine: Engine, private hooks: Hooks, label: string) {
    this.client = new LSPClient({
      rootUri: "file:///",
      timeout: 20_000,
      workspace: (client) => (this.workspace = new OneFile(client)),
      sanitizeHTML: (html) => html.replace(/<(?!\/?(p|em|strong|code|pre|ul|ol|li|br|h[1-6]|span|hr|table|thead|tbody|tr|td|th)\b)[^>]*>/gi, ""),
    });
    this.line = new Line(engine, (message) => this.hear(message));
    this.client.connect(this.line);
    this.workspace.show = (uri) => {
      this.hooks.show(decodeURIComponent(uri.slice("file://".length)));
      return this.view;
    };
    this.view = new EditorView({ state: this.state("", "/empty.esm", label) });
  }

  private state(text: string, path: string, label: string): EditorState {
    return EditorState.create({
      doc: text,
      extensions: [
        lineNumbers(), highlightActiveLineGutter(), history(), drawSelection(), indentOnInput(), bracketMatching(),
        closeBrackets(), autocompletion(), highlightActiveLine(), lintGutter(),
        language, syntaxHighlighting(colours), EditorState.tabSize.of(4),
        EditorView.contentAttributes.of({ "aria-label": label, tabindex: "0" }),
        keymap.of([
          { key: "Escape", run: temporarilySetTabFocusMode },
          ...closeBracketsKeymap, ...defaultKeymap, ...historyKeymap, ...completionKeymap, ...lintKeymap,
          ...formatKeymap, ...renameKeymap, ...jumpToDefinitionKeymap, indentWithTab,
        ]),
        this.client.plugin(uriOf(path), "esm"), serverCompletion(), hoverTooltips(),
        EditorView.updateListener.of((update) => {
          if (update.docChanged) {
            this.hooks.changed(update.state.doc.toString());
            clearTimeout(this.pending);
            this.pending = setTimeout(() => this.client.sync(), 0) as unknown as number;
          }
          if (update.selectionSet || update.docChanged) this.hooks.moved(update.state.selection.main.head);
        }),
      ],
    });
  }

  /** Shows a file. */
  open(path: string, text: string, label: string): void {
    this.path = path;
    this.view.setState(this.state(text, path, label));
  }

  /** Connects to an engine that was started anew. */
  again(): void {
    this.client.disconnect();
    // It opens the files that are open.
    this.client.connect(this.line);
  }

  format(): void {
    formatDocument(this.view);
    this.view.focus();
  }

  /** Puts the cursor at an offset in bytes of UTF-8. */
  goTo(bytes: number): void {
    const text = this.view.state.doc.toString();
    this.goToOffset(new TextDecoder().decode(new TextEncoder().encode(text).slice(0, bytes)).length);
  }

  goToOffset(offset: number): void {
    const at = Math.min(offset, this.view.state.doc.length);
    this.view.dispatch({ selection: { anchor: at }, effects: EditorView.scrollIntoView(at, { y: "center" }) });
    this.view.focus();
  }

  /** Applies a fix. */
  fix(fix: Problem["fixes"][number]): void {
    const changes = fix.edits.map(({ range, newText }) => ({
      from: this.offset(range.start), to: this.offset(range.end), insert: newText,
    }));
    this.view.dispatch({ changes });
    this.view.focus();
  }

  offset({ line, character }: { line: number; character: number }): number {
    const doc = this.view.state.doc;
    if (line >= doc.lines) return doc.length;
    const at = doc.line(line + 1);
    return Math.min(at.from + character, at.to);
  }

  private hear(message: Message): void {
    if (message.method !== "textDocument/publishDiagnostics") return;
    const { uri, diagnostics, version } = message.params as {
      uri: string; diagnostics: Diagnostic[]; version?: number;
    };
    if (uri !== uriOf(this.path)) return;
    const file = this.workspace.files.find((file) => file.uri === uri);
    // Of a text that has changed meanwhile: the next is on its way.
    if (file && version != null && version !== file.version) return;
    this.show(diagnostics.map((it) => ({ ...it, fixes: [] })));
    if (diagnostics.length > 0) void this.findFixes(uri, diagnostics);
  }

  private async findFixes(uri: string, diagnostics: Diagnostic[]): Promise<void> {
    const before = this.view.state.doc;
    const end = { line: before.lines, character: 0 };
    type Action = {
      title: string;
      diagnostics: Diagnostic[];
      edit?: { changes?: Record<string, Problem["fixes"][number]["edits"]> };
    };
    const params = {
      textDocument: { uri }, range: { start: { line: 0, character: 0 }, end }, context: { diagnostics },
    };
    let actions: Action[];
    try {
      actions = (await this.client.request<unknown, Action[]>("textDocument/codeAction", params)) ?? [];
    } catch {
      // Overtaken by a change.
      return;
    }
    if (this.view.state.doc !== before) return;
    const same = (a: Diagnostic, b: Diagnostic) =>
      a.message === b.message && a.range.start.line === b.range.start.line
      && a.range.start.character === b.range.start.character;
    this.show(diagnostics.map((diagnostic) => ({
      ...diagnostic,
      fixes: actions
        .filter((action) => action.diagnostics.some((it) => same(it, diagnostic)))
        .map((action) => ({ title: action.title, edits: action.edit?.changes?.[uri] ?? [] }))
        .filter((fix) => fix.edits.length > 0),
    })));
  }

  private show(problems: Problem[]): void {
    const severities = ["error", "error", "warning", "info", "hint"] as const;
    const shown = problems.map((problem) => ({
      from: this.offset(problem.range.start),
      to: this.offset(problem.range.end),
      severity: severities[problem.severity] ?? "error",
      message: problem.message,
      source: problem.code,
      actions: problem.fixes.map((fix) => ({ name: fix.title, apply: () => this.fix(fix) })),
    }));
    this.view.dispatch(setDiagnostics(this.view.state, shown));
    this.hooks.problems(problems);
  }
}
