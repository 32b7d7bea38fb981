//! The view drawn on a terminal's screen: on a wide one all panels side by side, on a small one
//! that which is scrolled alone.

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Borders, Paragraph};

use super::view::{Panel, View};
use crate::cli::terminal::{Palette, broken};
use crate::recording::walk::{Passed, Taken};
use crate::recording::{EventThen, FlagThen, TimerThen};
use crate::run::mission::hash_text;

/// Fewer columns than this show nothing.
const LEAST_COLUMNS: u16 = 20;
/// Columns of a screen that has all panels side by side.
const WIDE_COLUMNS: u16 = 100;
/// Columns of a screen that has the transitions beside the other panels.
const MIDDLE_COLUMNS: u16 = 60;
/// Lines that a panel has if it is not alone.
const PANEL_LINES: u16 = 5;
/// Lines that a screen has before the message has one of its own.
const MESSAGE_LINES: u16 = 12;
/// What keys do.
const KEYS: &str = "q: quit   n b: micro step   N B: macro step   / ?: go to, find   g G: ends   PgDn PgUp: 100   Tab up down: scroll";

/// Draws the view.
pub fn draw(frame: &mut Frame<'_>, view: &mut View<'_>, palette: Palette) {
    let area = frame.area();
    if area.width < LEAST_COLUMNS || area.height == 0 {
        frame.render_widget("too small", area);
        return;
    }
    let mut head = broken(&[head(view, palette)], area.width);
    // Half of a small screen is for the panels.
    head.truncate(usize::from(area.height / 4).max(1));
    let head_lines = u16::try_from(head.len()).unwrap_or(1);
    let foot = foot(view, area, palette);
    let foot_lines = u16::try_from(foot.len()).unwrap_or(1);
    let [head_area, body, foot_area] = Layout::vertical([
        Constraint::Max(head_lines),
        Constraint::Fill(1),
        Constraint::Length(foot_lines.min(area.height.saturating_sub(head_lines))),
    ])
    .areas(area);
    frame.render_widget(Paragraph::new(head), head_area);
    frame.render_widget(Paragraph::new(foot), foot_area);
    for (panel, area) in arranged(body, view.focus()) {
        draw_panel(frame, area, panel, view, palette);
    }
}

/// Which panels there are on a screen, and where.
fn arranged(area: Rect, focus: Panel) -> Vec<(Panel, Rect)> {
    const ONE: Constraint = Constraint::Fill(1);
    if area.width >= WIDE_COLUMNS {
        let columns = [
            Constraint::Fill(3),
            Constraint::Fill(4),
            Constraint::Fill(3),
        ];
        let areas: [Rect; 3] = Layout::horizontal(columns).spacing(1).areas(area);
        Panel::ALL.into_iter().zip(areas).collect()
    } else if area.width >= MIDDLE_COLUMNS && area.height >= 2 * PANEL_LINES {
        let [left, right] = Layout::horizontal([Constraint::Fill(4), Constraint::Fill(5)])
            .spacing(1)
            .areas(area);
        let [above, below] = Layout::vertical([ONE, ONE]).areas(left);
        vec![
            (Panel::Regions, above),
            (Panel::Transitions, right),
            (Panel::Flags, below),
        ]
    } else if area.height >= 3 * PANEL_LINES {
        let areas: [Rect; 3] = Layout::vertical([ONE, ONE, ONE]).areas(area);
        Panel::ALL.into_iter().zip(areas).collect()
    } else {
        vec![(focus, area)]
    }
}

/// The line that says where in the recording this is.
fn head<'v>(view: &'v View<'_>, palette: Palette) -> Line<'v> {
    let mut spans = vec![Span::styled(
        view.name(),
        Style::new().add_modifier(Modifier::BOLD),
    )];
    let (Some(moment), Some((stretch, number, stretches))) = (view.moment(), view.stretch()) else {
        return Line::from(spans);
    };
    let mission = format!("  {} {}", moment.mission, hash_text(stretch.mission));
    spans.push(Span::raw(mission));
    if stretches > 1 {
        spans.push(Span::raw(format!("  run {number} of {stretches}")));
    }
    if stretch.after_gap {
        spans.push(Span::styled("  after a gap", palette.warning()));
    }
    spans.push(Span::styled(
        format!("  {}", seconds(moment.t_us)),
        palette.good(),
    ));
    spans.push(Span::raw(format!("  macro step {}", moment.step)));
    spans.push(match view.place() {
        (Some(place), all) => Span::raw(format!("  micro step {}  {place}/{all}", moment.micro)),
        (None, _) => Span::raw("  no transition"),
    });
    if let Some(fault) = moment.fault {
        let text = format!("  ended by {}", fault.code());
        spans.push(Span::styled(text, palette.bad()));
    }
    Line::from(spans)
}

/// Question or message, and what keys do; on a low screen one of them.
fn foot<'v>(view: &'v View<'_>, area: Rect, palette: Palette) -> Vec<Line<'v>> {
    let said = match (view.question(), view.message()) {
        (Some(question), _) => Some(Line::from(vec![
            Span::styled(
                match question.is_backwards {
                    true => "back to STATE or STATE.FLAG: ",
                    false => "to TIME, STEP, STATE or STATE.FLAG: ",
                },
                palette.warning(),
            ),
            // Of a long answer the end is what is typed at.
            Span::raw(tail(&question.answer, usize::from(area.width) * 2 / 3)),
            Span::styled(" ", Style::new().add_modifier(Modifier::REVERSED)),
        ])),
        (None, Some(message)) => Some(Line::styled(message, palette.warning())),
        (None, None) => None,
    };
    let keys = Line::styled(KEYS, palette.quiet());
    match said {
        _ if area.height < 2 => Vec::new(),
        said if area.height >= MESSAGE_LINES => {
            let said = broken(&[said.unwrap_or_default()], area.width);
            let most = usize::from(area.height / 5);
            said.into_iter().take(most).chain([keys]).collect()
        }
        Some(said) => vec![said],
        None => vec![keys],
    }
}

fn draw_panel(
    frame: &mut Frame<'_>,
    area: Rect,
    panel: Panel,
    view: &mut View<'_>,
    palette: Palette,
) {
    let width = usize::from(area.width);
    let (title, lines) = match panel {
        Panel::Regions => (" states ", regions(view, palette)),
        Panel::Transitions => (" transitions ", transitions(view, palette)),
        Panel::Flags => (" flags and timers ", flags_and_timers(view, width, palette)),
    };
    let lines: Vec<Line<'_>> = lines.iter().flat_map(|line| folded(line, width)).collect();
    let title = match view.focus() == panel {
        true => Span::styled(title, Style::new().add_modifier(Modifier::REVERSED)),
        false => Span::raw(title),
    };
    let visible = usize::from(area.height.saturating_sub(1));
    let hidden = lines.len().saturating_sub(visible);
    let mut block = Block::new().borders(Borders::TOP).title(title);
    if hidden > 0 {
        let of_all = format!(" {visible} of {} lines ", lines.len());
        block = block.title(Line::raw(of_all).right_aligned());
    }
    let text = Paragraph::new(lines).block(block);
    view.keep_within(panel, u16::try_from(hidden).unwrap_or(u16::MAX));
    frame.render_widget(text.scroll((view.scrolled(panel), 0)), area);
}

/// A line in as many as its letters need; what goes on is set in as far as the line is.
fn folded(line: &Line<'static>, width: usize) -> Vec<Line<'static>> {
    let letters = |line: &Line<'_>| line.width();
    if letters(line) <= width {
        return vec![line.clone()];
    }
    let text: String = line.spans.iter().map(|span| &*span.content).collect();
    let indent = text.len() - text.trim_start_matches([' ', '*']).len() + 2;
    let indent = indent.min(width / 2);
    let mut lines = Vec::new();
    let mut here = String::new();
    let mut used = 0;
    // Paths have no blanks to break at: they are broken where the line ends.
    for word in text.split_inclusive([' ', '/']) {
        let mut rest = word;
        while !rest.is_empty() {
            let room = width.saturating_sub(used);
            let count = rest.trim_end().chars().count();
            if count > room && used > indent {
                lines.push(std::mem::replace(&mut here, " ".repeat(indent)));
                used = indent;
                continue;
            }
            let end = rest
                .char_indices()
                .nth(room.max(1))
                .map_or(rest.len(), |(at, _)| at);
            let (taken, behind) = match count > room {
                true => rest.split_at(end),
                false => (rest, ""),
            };
            here.push_str(taken);
            used += taken.chars().count();
            rest = behind;
        }
    }
    lines.push(here);
    let style = line
        .spans
        .first()
        .map_or(line.style, |span| line.style.patch(span.style));
    lines
        .into_iter()
        .map(|text| Line::styled(text, style))
        .collect()
}

/// What is new has a star.
fn mark(is_new: bool) -> &'static str {
    if is_new { "* " } else { "  " }
}

fn style_of(is_new: bool, palette: Palette) -> Style {
    if is_new {
        palette.warning()
    } else {
        Style::new()
    }
}

/// The tree of regions.
fn regions(view: &View<'_>, palette: Palette) -> Vec<Line<'static>> {
    let regions = view.surroundings().regions.iter();
    regions
        .map(|region| {
            let indent = "  ".repeat(region.depth);
            let text = format!(
                "{}{indent}{}: {}",
                mark(region.is_new),
                region.name,
                region.state
            );
            Line::styled(text, style_of(region.is_new, palette))
        })
        .collect()
}

/// The transitions of the micro step, and the events of the macro step.
fn transitions(view: &View<'_>, palette: Palette) -> Vec<Line<'static>> {
    let Some(moment) = view.moment() else {
        return Vec::new();
    };
    let mut lines = vec![Line::raw(format!("on {}", moment.event))];
    if moment.taken.is_empty() {
        lines.push(Line::raw("no transition was taken; a flag changed"));
    }
    for taken in &moment.taken {
        lines.push(Line::styled(taken.from.clone(), palette.warning()));
        lines.push(Line::styled(
            format!("  -> {}", taken.to),
            palette.warning(),
        ));
        told(taken, &mut lines);
        for passed in &taken.passed {
            lines.extend(
                passed_by(passed)
                    .into_iter()
                    .map(|line| line.style(palette.quiet())),
            );
        }
    }
    lines.push(Line::raw(""));
    lines.push(Line::raw("events of this macro step"));
    for event in &view.surroundings().events {
        let is_now = event.micro == usize::from(moment.micro);
        let line = Line::raw(event_line(event, is_now));
        lines.push(line.style(style_of(is_now, palette)));
    }
    lines
}

/// Guard and actions of a transition.
fn told(taken: &Taken, lines: &mut Vec<Line<'static>>) {
    if let Some(guard) = &taken.guard {
        lines.push(Line::raw(format!("  [{guard}]")));
        lines.extend(terms(&taken.terms));
    }
    for (verb, what) in [
        ("sends", &taken.sent),
        ("sets", &taken.set),
        ("clears", &taken.cleared),
    ] {
        lines.extend(
            what.iter()
                .map(|what| Line::raw(format!("  {verb} {what}"))),
        );
    }
}

/// A transition that came before and was not taken.
fn passed_by(passed: &Passed) -> Vec<Line<'static>> {
    let guard = passed.guard.as_deref().unwrap_or_default();
    let mut lines = vec![Line::raw(format!("  not {} [{guard}]", passed.to))];
    lines.extend(terms(&passed.terms));
    lines
}

fn terms(terms: &[(String, bool)]) -> impl Iterator<Item = Line<'static>> {
    let line = |(name, is): &(String, bool)| Line::raw(format!("    {name} = {is}"));
    terms.iter().map(line)
}

fn event_line(event: &EventThen, is_now: bool) -> String {
    let mut text = format!("{}{} {}", mark(is_now), event.micro, event.name);
    if let Some(sender) = &event.sent_by {
        text += &format!(", sent from {sender}, ");
        text += &match event.heard_by.as_slice() {
            [] => "heard by none".to_owned(),
            regions => format!("heard by {}", regions.join(", ")),
        };
    }
    text
}

/// The flags of states that are current, state by state, and the timers.
fn flags_and_timers(view: &View<'_>, width: usize, palette: Palette) -> Vec<Line<'static>> {
    let surroundings = view.surroundings();
    let mut lines: Vec<Line<'static>> = Vec::new();
    let of_one = surroundings.flags.chunk_by(|a, b| a.state == b.state);
    for flags in of_one {
        // What every state has is shown where it says something.
        let says = |flag: &&FlagThen| !flag.of_system || flag.is_set || flag.is_new;
        let mut shown = flags.iter().filter(says).peekable();
        if let Some(first) = shown.peek() {
            lines.push(Line::raw(tail(&first.state, width)));
        }
        for flag in shown {
            let text = format!("{}  .{} = {}", mark(flag.is_new), flag.name, flag.is_set);
            lines.push(Line::styled(text, style_of(flag.is_new, palette)));
        }
    }
    if !lines.is_empty() && !surroundings.timers.is_empty() {
        lines.push(Line::raw(""));
    }
    for timer in &surroundings.timers {
        lines.push(Line::raw(tail(&timer.state, width)));
        let style = if timer.is_over {
            palette.warning()
        } else {
            Style::new()
        };
        lines.push(Line::styled(timer_line(timer), style));
    }
    lines
}

fn timer_line(timer: &TimerThen) -> String {
    let over = if timer.is_over { ", timeout" } else { "" };
    format!(
        "    {} of {}{over}",
        seconds(timer.age_us),
        seconds(timer.limit_us)
    )
}

fn seconds(us: u64) -> String {
    format!("{}.{:03} s", us / 1_000_000, us / 1_000 % 1_000)
}

/// The last letters of a text.
fn tail(text: &str, width: usize) -> String {
    let letters = text.chars().count();
    if letters <= width {
        return text.to_owned();
    }
    let kept = width.saturating_sub(1);
    let rest: String = text.chars().skip(letters - kept).collect();
    format!("…{rest}")
}

#[cfg(test)]
mod tests {
    use ratatui::buffer::Buffer;

    use super::super::view::tests::{drive, press, view_of};
    use super::*;
    use crate::cli::terminal::tests::{self as terminal, assert_golden, coloured, text};

    fn drawn(view: &mut View<'_>, (width, height): (u16, u16), colour: bool) -> Buffer {
        terminal::drawn(width, height, |frame| draw(frame, view, Palette { colour }))
    }

    #[test]
    fn the_screen_is_as_it_was_when_it_was_looked_at() {
        let recording = drive();
        for (name, keys, over_gaps, size) in [
            ("wide", "/5!", true, (140, 24)),
            ("usual", "/5!n", true, (80, 24)),
            (
                "guards_that_were_passed_by",
                "/motion/Again/turn/Back!",
                true,
                (110, 26),
            ),
            ("narrow", "/5!n", true, (50, 30)),
            ("low", "/5!", true, (80, 6)),
            ("one_line", "/5!", true, (80, 1)),
            ("low_and_asked", "/5!/Esc", true, (80, 6)),
            ("asked", "/5!?motion/Escape/turn/Ba", true, (80, 20)),
            ("behind_a_gap", "/20 s!", true, (120, 20)),
            ("at_a_gap", "Gn", false, (90, 22)),
            ("no_transition", "G?motion/Cruise.near!", true, (120, 20)),
            ("another_mission", "Gvvv", true, (120, 16)),
        ] {
            let mut view = view_of(&recording, over_gaps);
            let _ = press(&mut view, keys);
            assert_golden("step", name, &text(&drawn(&mut view, size, false)));
        }
    }

    #[test]
    fn any_size_of_screen_can_be_drawn_on() {
        let recording = drive();
        let mut view = view_of(&recording, true);
        let _ = press(&mut view, "/5!vvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvv/x");
        for width in [1, 19, 20, 33, 59, 60, 99, 100, 140] {
            for height in (1..=20).chain([40]) {
                drawn(&mut view, (width, height), true);
            }
        }
    }

    #[test]
    fn what_is_scrolled_ends_with_its_last_line() {
        let recording = drive();
        let mut view = view_of(&recording, true);
        let _ = press(&mut view, "/5!vvvvvvvvvvvvvvvvvvvvvvvvv");
        let screen = text(&drawn(&mut view, (80, 12), false));
        assert!(screen.contains("1 Obstacle"), "{screen}");
        let before = view.scrolled(Panel::Transitions);
        let _ = press(&mut view, "^");
        assert_eq!(view.scrolled(Panel::Transitions), before - 1, "at once");
        // On a small screen the panel that is scrolled is the one that shows.
        for (key, words) in [
            ("|", ".near = true"),
            ("|", "safety: Watch"),
            ("|", "sends Obstacle"),
        ] {
            let _ = press(&mut view, key);
            let screen = text(&drawn(&mut view, (80, 9), false));
            assert!(screen.contains(words), "{words}: {screen}");
        }
    }

    #[test]
    fn where_there_is_to_be_no_colour_there_is_none() {
        let recording = drive();
        let mut view = view_of(&recording, true);
        let _ = press(&mut view, "/5!");
        for size in [(140, 24), (50, 12)] {
            assert_eq!(coloured(&drawn(&mut view, size, false)), 0);
            assert!(coloured(&drawn(&mut view, size, true)) > 0);
        }
    }

    #[test]
    fn a_long_line_is_folded_where_its_words_end() {
        for (line, width, expected) in [
            ("  short", 10, &["  short"][..]),
            ("  motion/Roam/steps", 14, &["  motion/Roam/", "    steps"]),
            ("* [a and b or c]", 9, &["* [a and ", "    b or ", "    c]"]),
            (
                "abcdefghijklmnop",
                6,
                &["abcdef", "  ghij", "  klmn", "  op"],
            ),
            ("", 5, &[""]),
        ] {
            let folded = folded(&Line::raw(line.to_owned()), width);
            let found: Vec<String> = folded.iter().map(Line::to_string).collect();
            assert_eq!(found, expected, "{line:?} in {width}");
        }
    }
}
