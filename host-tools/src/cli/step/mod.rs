//! `esm replay --step` on a terminal: a recording walked through on the screen.
//!
//! | module | what it holds |
//! |---|---|
//! | [`view`] | what a person sees of a moment, and what their keys do |
//! | [`screen`] | the view drawn on a terminal's screen |

pub mod screen;
pub mod view;

use std::ops::ControlFlow;
use std::time::Duration;

use ratatui::Frame;
use ratatui::crossterm::event::KeyEvent;

use super::console::Console;
use super::exit::CommandError;
use super::terminal::{self, KEY_WAIT, Palette, Shown};
use crate::run::interrupt::Interrupt;
use view::View;

/// Shows a recording until the person has seen enough.
///
/// # Errors
/// What the system says of the terminal.
pub fn show(view: View<'_>, console: &Console) -> Result<(), CommandError> {
    let interrupt = Interrupt::take_over()?;
    let palette = Palette {
        colour: console.colour_out(),
    };
    terminal::show(&mut Stepping { view, palette }, interrupt)
}

/// A recording on the screen.
struct Stepping<'r> {
    view: View<'r>,
    palette: Palette,
}

impl Shown for Stepping<'_> {
    fn update(&mut self) -> Result<Duration, CommandError> {
        // A search goes on between two keys, so that it can be left.
        Ok(match self.view.look() {
            true => Duration::ZERO,
            false => KEY_WAIT,
        })
    }

    fn draw(&mut self, frame: &mut Frame<'_>) {
        screen::draw(frame, &mut self.view, self.palette);
    }

    fn press(&mut self, key: KeyEvent) -> ControlFlow<()> {
        self.view.press(key)
    }
}
