//! Commands that take the screen of a terminal: `esm replay --step`, and what gives the terminal
//! back whatever ends them.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::ops::ControlFlow;
use std::process::Command;
use std::time::Duration;

use esm_tests::command::{esm_binary, root};
use esm_tests::recorded::RecordedRun;
use esm_tests::terminal::Session;
use host_tools::cli::exit::CommandError;
use host_tools::cli::terminal::{KEY_WAIT, Shown, show};
use host_tools::run::interrupt::Interrupt;
use ratatui::Frame;
use ratatui::crossterm::event::KeyEvent;

#[test]
fn a_recording_is_walked_through_on_the_screen_and_the_terminal_is_given_back() {
    let made = RecordedRun {
        missions: &[(0, "patrol", false)],
        world: "office",
        seed: 1,
        until_s: 20,
    }
    .made();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("patrol.rec");
    std::fs::write(&path, made.recording).unwrap();
    let on_a_terminal = |more: &[&str]| {
        let mut command = Command::new(esm_binary());
        command.current_dir(root()).arg("replay").arg(&path);
        Session::start(command.arg("--step").args(more))
    };

    let mut session = on_a_terminal(&[]);
    session.wait_for("sonars/Listen");
    assert!(!session.is_as_before(), "it reads keys one by one");
    session.press(b"/16490 ms\r");
    session.wait_for(".left_freer");
    session.press(b"\x1b[D"); // the arrow to the left
    session.wait_for("diary/Write");
    session.press(b"q");
    session.ends_well("q");

    let mut session = on_a_terminal(&[]);
    session.wait_for("sonars/Listen");
    session.press(b"/\x03"); // Ctrl-C, also where an answer is typed
    session.ends_well("Ctrl-C");

    let mut session = on_a_terminal(&["--plain"]);
    session.press(b"t 16490 ms\n");
    session.wait_for("[.near and .left_freer]");
    assert!(session.is_as_before());
}

/// What the program below is to do, in its environment.
const PLANTED: &str = "ESM_TEST_SCREEN_ENDS_BY";

/// A command that goes wrong while it has the screen.
struct GoesWrong {
    how: String,
    drawn: u32,
}

impl Shown for GoesWrong {
    fn update(&mut self) -> Result<Duration, CommandError> {
        match self.how.as_str() {
            _ if self.drawn < 2 => {}
            "an error" => return Err(CommandError::World(anyhow::anyhow!("planted"))),
            "a panic elsewhere" => {
                let ended = std::thread::spawn(|| panic!("planted")).join();
                assert!(ended.is_err());
            }
            _ => {}
        }
        Ok(KEY_WAIT)
    }

    fn draw(&mut self, frame: &mut Frame<'_>) {
        self.drawn += 1;
        frame.render_widget("drawn", frame.area());
        assert!(self.how != "a panic" || self.drawn < 2, "planted");
    }

    fn press(&mut self, _: KeyEvent) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
}

/// Is no test by itself: the one below starts it on a terminal.
#[test]
fn goes_wrong_where_it_is_asked_to() {
    let Ok(how) = std::env::var(PLANTED) else {
        return;
    };
    let interrupt = Interrupt::take_over().unwrap();
    let ended = show(&mut GoesWrong { how, drawn: 0 }, interrupt);
    panic!("it said: {}", ended.unwrap_err().message().unwrap());
}

#[test]
fn an_error_and_a_panic_are_said_behind_the_screen_that_was_given_back() {
    for (how, said) in [
        ("an error", "it said: planted"),
        ("a panic", "planted"),
        (
            "a panic elsewhere",
            "it said: a part of this command has failed",
        ),
    ] {
        let mut command = Command::new(std::env::current_exe().unwrap());
        command
            .args(["--exact", "--nocapture", "goes_wrong_where_it_is_asked_to"])
            .env(PLANTED, how);
        let session = Session::start(&mut command);
        let (status, behind) = session.end(how);
        assert_eq!(status, Some(101), "{how}: {behind}");
        assert!(behind.contains("planted"), "{how}: {behind}");
        assert!(behind.contains(said), "{how}: {behind}");
        assert!(!behind.contains("drawn"), "{how}: {behind}");
    }
}
