//! A command that has a terminal of its own: what it shows, keys for it, and whether it gives the
//! terminal back as it was.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::fs::{File, OpenOptions};
use std::io::Write;
use std::process::{Child, Command};
use std::time::{Duration, Instant};

use host_tools::serial::ByteLink;
use host_tools::serial::pipe::{self, PipeEnd};
use host_tools::serial::pty::PtyServer;

/// How long a command may take to show something, or to end: nothing is found out by its being
/// short.
const PATIENCE: Duration = Duration::from_secs(60);
/// What a terminal is told to give back the screen that it had before.
const LEAVE_SCREEN: &str = "\x1b[?1049l";
/// What it is told to show its cursor.
const SHOW_CURSOR: &str = "\x1b[?25h";

/// A command on a terminal of its own.
pub struct Session {
    child: Child,
    terminal: PtyServer,
    /// A terminal that nobody has open forgets what was last written to it.
    open: File,
    /// The keyboard, and what is shown.
    far: PipeEnd,
    /// What was shown since the last word that was waited for.
    shown: String,
    /// How the terminal was set before.
    settings: String,
}

impl Session {
    /// Starts a command on a terminal of 30 lines and 120 columns.
    ///
    /// # Panics
    /// If it cannot be started.
    pub fn start(command: &mut Command) -> Self {
        let (near, far) = pipe::pair();
        let terminal = PtyServer::start(Box::new(near)).unwrap();
        let path = terminal.path().to_str().unwrap().to_owned();
        stty(&path, &["sane", "rows", "30", "cols", "120"]);
        let settings = stty(&path, &["-g"]);
        let open = || {
            let mut options = OpenOptions::new();
            options.read(true).write(true).open(&path).unwrap()
        };
        let child = command
            .env("TERM", "xterm-256color")
            .env_remove("NO_COLOR")
            .stdin(open())
            .stdout(open())
            .stderr(open())
            .spawn()
            .unwrap();
        Session {
            child,
            open: open(),
            terminal,
            far,
            shown: String::new(),
            settings,
        }
    }

    /// Waits until a word has been shown since the last call. Blanks are moved over and not shown,
    /// so that it is one word.
    ///
    /// # Panics
    /// If it is not shown.
    #[track_caller]
    pub fn wait_for(&mut self, word: &str) {
        let deadline = Instant::now() + PATIENCE;
        while !self.shown.contains(word) {
            assert!(
                Instant::now() < deadline,
                "`{word}` was not shown: {:?}",
                self.shown
            );
            self.look();
        }
        self.shown.clear();
    }

    fn look(&mut self) {
        let mut bytes = [0; 4096];
        let count = self.far.receive(&mut bytes, Duration::from_millis(50));
        let count = count.unwrap();
        self.shown
            .push_str(&String::from_utf8_lossy(&bytes[..count]));
    }

    /// Presses keys.
    ///
    /// # Panics
    /// If nobody takes them.
    pub fn press(&mut self, keys: &[u8]) {
        self.far.send(keys).unwrap();
    }

    /// Asks the command to end, as the system does.
    ///
    /// # Panics
    /// If it cannot be asked.
    pub fn terminate(&self) {
        let id = self.child.id().to_string();
        assert!(Command::new("kill").arg(&id).status().unwrap().success());
    }

    /// Whether the terminal is set as it was before the command.
    pub fn is_as_before(&self) -> bool {
        stty(self.terminal.path().to_str().unwrap(), &["-g"]) == self.settings
    }

    /// Waits for the command's good end, and looks whether the terminal is as it was.
    ///
    /// # Panics
    /// If it does not end, not well, or leaves the terminal otherwise.
    #[track_caller]
    pub fn ends_well(self, what: &str) {
        let (status, said) = self.end(what);
        assert_eq!((status, &*said), (Some(0), ""), "{what}");
    }

    /// Waits for the command's end, and looks whether the terminal is as it was. Answers the exit
    /// status, and what was said after the terminal was given back.
    ///
    /// # Panics
    /// If it does not end, or leaves the terminal otherwise.
    #[track_caller]
    pub fn end(mut self, what: &str) -> (Option<i32>, String) {
        let deadline = Instant::now() + PATIENCE;
        let status = loop {
            self.look();
            if let Some(status) = self.child.try_wait().unwrap() {
                break status;
            }
            assert!(Instant::now() < deadline, "{what}: it does not end");
        };
        // What the command wrote last may still be on its way; behind it comes this.
        const LAST: &str = "~last~";
        self.open.write_all(LAST.as_bytes()).unwrap();
        while !self.shown.contains(LAST) && Instant::now() < deadline {
            self.look();
        }
        let shown = self.shown.replace(LAST, "");
        let given_back = shown.rsplit_once(LEAVE_SCREEN);
        let Some((_, behind)) = given_back else {
            panic!("{what}: the screen was not given back: {shown:?}");
        };
        assert_eq!(shown.matches(LEAVE_SCREEN).count(), 1, "{what}: {shown:?}");
        assert!(behind.starts_with(SHOW_CURSOR), "{what}: {behind:?}");
        assert!(self.is_as_before(), "{what}");
        (status.code(), behind.replace(SHOW_CURSOR, ""))
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Sets a terminal, or asks how it is set.
fn stty(path: &str, arguments: &[&str]) -> String {
    let done = Command::new("stty")
        .args(["-F", path])
        .args(arguments)
        .output()
        .unwrap();
    assert!(done.status.success(), "{done:?}");
    String::from_utf8(done.stdout).unwrap()
}
