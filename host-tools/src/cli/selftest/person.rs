//! Whoever sees a robot's wheels: the person in front of it, or the simulation itself.

use std::io::{self, BufRead, IsTerminal};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::Duration;

use anyhow::anyhow;

use super::examine::Eyes;
use crate::cli::console::Console;
use crate::cli::exit::CommandError;
use crate::lockstep::plant_side::PlantSide;
use crate::run::interrupt;
use crate::selftest::wheels::{Seen, Turned};

/// How often Ctrl-C is looked for while a person thinks.
const LOOK_TIME: Duration = Duration::from_millis(100);

/// Whether somebody can be asked, and can answer.
pub fn is_there(console: &Console) -> bool {
    console.has_person() && io::stdin().is_terminal()
}

/// Asks a question, and waits for a line.
///
/// # Errors
/// Ctrl-C, or nobody answers any more.
fn ask(console: &mut Console, question: &str) -> Result<String, CommandError> {
    console.note(question);
    let (send, answers) = mpsc::channel();
    // It waits for the line as long as the process lives.
    thread::Builder::new().spawn(move || {
        let mut line = String::new();
        let read = io::stdin().lock().read_line(&mut line);
        // Who has asked may have gone.
        let _ = send.send(read.map(|_| line));
    })?;
    loop {
        match answers.recv_timeout(LOOK_TIME) {
            Ok(line) => return Ok(line?.trim().to_lowercase()),
            Err(RecvTimeoutError::Timeout) if !interrupt::is_requested() => {}
            Err(_) => {
                return Err(CommandError::World(anyhow!(
                    "ended by Ctrl-C before the question was answered"
                )));
            }
        }
    }
}

/// Asks whether the wheels are off the ground.
///
/// # Errors
/// Ctrl-C.
pub fn has_lifted_wheels(console: &mut Console) -> Result<bool, CommandError> {
    let answer = ask(
        console,
        "are the robot's wheels off the ground, and is nothing near them? They will turn. [y/N]",
    )?;
    Ok(matches!(answer.as_str(), "y" | "yes"))
}

/// A person at a terminal, or nobody.
pub struct Person<'c> {
    /// Where the person is asked; none where there is nobody.
    pub console: Option<&'c mut Console>,
}

impl Eyes for Person<'_> {
    fn before(&mut self) -> Result<(), CommandError> {
        let Some(console) = self.console.as_deref_mut() else {
            return Ok(());
        };
        let watch = "watch the wheels: three times both turn forwards for a moment; then the robot turns on the spot to the left, \
             the left wheel backwards and the right one forwards; then the other way round. Enter begins, Ctrl-C stops it at once";
        ask(console, watch).map(|_| ())
    }

    fn turned(&self) -> Option<[f64; 2]> {
        None
    }

    fn seen(&mut self) -> Result<Option<Seen>, CommandError> {
        let Some(console) = self.console.as_deref_mut() else {
            return Ok(None);
        };
        let how = "two letters, for the left and the right wheel: f forwards, b backwards, n not at all, as in `ff`; only Enter if you have not seen it";
        let mut asked = |when: &str| loop {
            let answer = ask(console, &format!("how did the wheels turn {when}? {how}"))?;
            if answer.is_empty() {
                return Ok(None);
            }
            match both(&answer) {
                Some(both) => return Ok::<_, CommandError>(Some(both)),
                None => console.note("that is no answer"),
            }
        };
        let Some(ahead) = asked("the first three times, when both were to turn forwards")? else {
            return Ok(None);
        };
        let left =
            asked("then, when the left one was to turn backwards and the right one forwards")?;
        Ok(left.map(|left| Seen { ahead, left }))
    }
}

/// What two letters say of the left and the right wheel.
fn both(answer: &str) -> Option<[Turned; 2]> {
    let turned = |letter: char| match letter {
        'f' => Some(Turned::Forwards),
        'b' => Some(Turned::Backwards),
        'n' => Some(Turned::Not),
        _ => None,
    };
    let mut letters = answer.chars().filter(|letter| *letter != ' ');
    let both = [turned(letters.next()?)?, turned(letters.next()?)?];
    letters.next().is_none().then_some(both)
}

/// The simulation: it knows how its wheels turn.
pub struct Simulation<'p> {
    /// The simulated body.
    pub plant: &'p PlantSide,
}

impl Eyes for Simulation<'_> {
    fn before(&mut self) -> Result<(), CommandError> {
        Ok(())
    }

    fn turned(&self) -> Option<[f64; 2]> {
        Some(self.plant.wheels_turned_rad())
    }

    fn seen(&mut self) -> Result<Option<Seen>, CommandError> {
        Ok(None)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_letters_say_how_the_wheels_turned() {
        use Turned::{Backwards, Forwards, Not};
        for (answer, expected) in [
            ("ff", Some([Forwards, Forwards])),
            ("b f", Some([Backwards, Forwards])),
            ("nn", Some([Not, Not])),
            ("f", None),
            ("fff", None),
            ("fx", None),
            ("yes", None),
        ] {
            assert_eq!(both(answer), expected, "{answer}");
        }
    }
}
