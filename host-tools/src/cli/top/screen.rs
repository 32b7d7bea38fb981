//! The view drawn on a terminal's screen. Whatever its size, what matters most is there: first the
//! slots, then the state of the robot, then start delays and tasks of one slot.

use std::borrow::Cow;

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Borders, Cell, Paragraph, Row, Table, TableState, Wrap};

use super::report::{TopTask, hertz, percent};
use super::view::{SlotRow, View};
use crate::cli::status::{FINISHED, mode_words};
use crate::cli::terminal::{Palette, broken};
use crate::counters::{DelayBucket, Ns};
use crate::run::mission::hash_text;

/// Lines of the head where none is broken: robot and mission, load and line, states.
const HEAD_LINES: u16 = 3;
/// Lines of the slots' table at least: its edge, its head, a slot.
const TABLE_LINES: u16 = 3;
/// Lines of the panels below it: an edge, and one for each bucket of start delays.
const PANEL_LINES: u16 = 9;
/// Lines of the panel of nets at least: an edge, and a net.
const LEAST_NET_LINES: u16 = 2;
/// Columns of the panel of start delays.
const DELAY_COLUMNS: u16 = 42;
/// Columns that its bars may have.
const BAR_COLUMNS: usize = 16;
/// Fewer columns than this show nothing.
const LEAST_COLUMNS: u16 = 20;
/// What keys do.
const KEYS: &str = "q: quit   arrows: slot   r: count from now   p: pause";

/// How many lines the parts of a screen have.
struct Heights {
    head: u16,
    table: u16,
    panels: u16,
    foot: u16,
}

impl Heights {
    /// Those of a screen of so many lines, with so many for the head if it can have them. The table
    /// goes last, and has its head and the slot that is looked at as long as anything fits.
    fn of(height: u16, head_lines: u16) -> Self {
        let spare = height.saturating_sub(TABLE_LINES);
        let head = if spare > head_lines {
            head_lines
        } else {
            spare.min(1)
        };
        let foot = u16::from(spare > head);
        let spare = spare.saturating_sub(head + foot);
        let panels = if spare >= PANEL_LINES { PANEL_LINES } else { 0 };
        Heights {
            head,
            table: height.saturating_sub(head + foot + panels),
            panels,
            foot,
        }
    }
}

/// Draws the view.
pub fn draw(frame: &mut Frame<'_>, view: &View, palette: Palette) {
    let area = frame.area();
    if area.width < LEAST_COLUMNS || area.height == 0 {
        frame.render_widget("too small", area);
        return;
    }
    let rows = view.rows();
    let head = head(view, &rows, palette);
    let plain = Heights::of(area.height, HEAD_LINES);
    // Lines of the head are broken where that takes nothing from the others, the first one, which
    // says what is wrong, in any case.
    let all_broken = broken(&head, area.width);
    let first_broken = [
        broken(head.get(..1).unwrap_or_default(), area.width),
        head.get(1..).unwrap_or_default().to_vec(),
    ]
    .concat();
    let heights = |head: &[Line<'_>]| {
        let lines = u16::try_from(head.len()).unwrap_or(u16::MAX);
        Some(Heights::of(area.height, lines)).filter(|heights| heights.head == lines)
    };
    let wanted = u16::try_from(rows.len() + 2).unwrap_or(u16::MAX);
    let takes_nothing =
        |it: &Heights| it.panels == plain.panels && it.table >= plain.table.min(wanted);
    let (head, heights) = match (
        heights(&all_broken).filter(takes_nothing),
        heights(&first_broken),
    ) {
        (Some(heights), _) => (all_broken, heights),
        (None, Some(heights)) => (first_broken, heights),
        (None, None) => (head, plain),
    };
    // Nets have what the table does not need.
    let net_lines = u16::try_from(view.nets().len() + 1).unwrap_or(u16::MAX);
    let spare = heights.table.saturating_sub(wanted);
    let nets_height = match view.nets() {
        [] => 0,
        _ if spare < LEAST_NET_LINES => 0,
        _ => spare.min(net_lines),
    };
    let [head_area, table, nets, panels, foot] = Layout::vertical([
        Constraint::Length(heights.head),
        Constraint::Length(heights.table - nets_height),
        Constraint::Length(nets_height),
        Constraint::Length(heights.panels),
        Constraint::Length(heights.foot),
    ])
    .areas(area);
    frame.render_widget(Paragraph::new(head), head_area);
    draw_table(frame, table, view, &rows, palette);
    if nets_height > 0 {
        draw_nets(frame, nets, view, palette);
    }
    if heights.panels > 0 {
        let [delays, tasks] =
            Layout::horizontal([Constraint::Max(DELAY_COLUMNS), Constraint::Fill(1)]).areas(panels);
        draw_delays(frame, delays, rows.get(view.selected()), palette);
        draw_tasks(frame, tasks, view, palette);
    }
    frame.render_widget(Line::styled(KEYS, palette.quiet()), foot);
}

/// The lines above the table.
fn head<'v>(view: &'v View, rows: &[SlotRow], palette: Palette) -> Vec<Line<'v>> {
    vec![
        title(view, palette),
        load(view, rows, palette),
        Line::raw(match view.reading() {
            Some(reading) if !reading.active.is_empty() => {
                format!("states {}", reading.active.join(", "))
            }
            _ => String::new(),
        }),
    ]
}

/// The line that says what there is to see, or why there is nothing new.
fn title<'v>(view: &'v View, palette: Palette) -> Line<'v> {
    let mut spans: Vec<Span<'v>> = Vec::new();
    if let Some((why, time)) = view.trouble() {
        let text = format!("no answer for {} s, trying again: {why}  ", time.as_secs());
        spans.push(Span::styled(text, palette.bad()));
    }
    if view.is_paused() {
        spans.push(Span::styled("paused  ", palette.warning()));
    }
    let robot = view.robot();
    spans.push(Span::styled(
        format!("{} on {}", robot.firmware, robot.board),
        Style::new().add_modifier(Modifier::BOLD),
    ));
    let Some(reading) = view.reading() else {
        spans.push(Span::raw("  …"));
        return Line::from(spans);
    };
    let status = &reading.status;
    let (mode, reason) = mode_words(status.mode);
    let (words, style) = match (mode, reason) {
        ("running", _) if reading.finished => (FINISHED.to_owned(), palette.good()),
        ("running", _) => (mode.to_owned(), palette.good()),
        (_, Some(reason)) => (format!("safe, motors off: {reason}"), palette.bad()),
        ("stopped", _) => ("stopped, motors off".to_owned(), palette.warning()),
        ("emergency stop", _) if status.stop_pressed => (
            "emergency stop, its button is pressed".to_owned(),
            palette.bad(),
        ),
        ("emergency stop", _) => ("emergency stop, latched".to_owned(), palette.bad()),
        _ => ("no mission".to_owned(), Style::new()),
    };
    if let (Some(machine), Some(mission)) = (&reading.machine, status.mission) {
        spans.push(Span::raw(format!("  {machine} {}", hash_text(mission))));
    }
    spans.push(Span::raw("  "));
    spans.push(Span::styled(words, style));
    if status.mission.is_some() {
        spans.push(Span::raw(format!(
            "  mission time {:.1} s, {} steps",
            status.t_us as f64 / 1e6,
            status.steps
        )));
    }
    Line::from(spans)
}

/// The line of load, faults and the link.
fn load<'v>(view: &'v View, rows: &[SlotRow], palette: Palette) -> Line<'v> {
    let Some(reading) = view.reading() else {
        return Line::default();
    };
    let status = &reading.status;
    let mut spans: Vec<Span<'v>> = Vec::new();
    if !reading.slots.is_empty() {
        let load = view.load();
        spans.push(Span::raw(format!(
            "slots take {} of {}, {} left for slot 0{}  ",
            percent(load.used),
            percent(Some(load.reserved)),
            percent(load.left()),
            if status.background_busy {
                " (busy)"
            } else {
                ""
            }
        )));
    }
    let mut count = |number: u64, what: &str, style: Style| {
        let style = if number > 0 { style } else { Style::new() };
        spans.push(Span::styled(format!("{number} {what}  "), style));
    };
    // What the table shows, added up: what the robot counts since it started is of earlier
    // missions, too.
    let sum = |of: fn(&SlotRow) -> u32| rows.iter().map(|row| u64::from(of(row))).sum();
    count(sum(|row| row.counted.overruns), "overruns", palette.bad());
    count(sum(|row| row.counted.missed), "missed", palette.bad());
    count(
        reading.line.requests_sent_again,
        "sent again",
        palette.warning(),
    );
    count(reading.line.frames_spoiled, "spoiled", palette.warning());
    if status.trace_dropped > 0 {
        count(
            status.trace_dropped.into(),
            "records dropped",
            palette.warning(),
        );
    }
    if let Some(bytes) = status.stack_bytes {
        spans.push(Span::raw(format!("stack {bytes}")));
    }
    Line::from(spans)
}

/// A column of the slots' table.
struct Column {
    name: &'static str,
    width: u16,
    /// Columns with higher numbers go first where there is no room for all.
    rank: u8,
    text: fn(&SlotRow) -> String,
}

const COLUMNS: [Column; 14] = [
    Column {
        name: "slot",
        width: 5,
        rank: 0,
        text: |row| row.plan.number.to_string(),
    },
    Column {
        name: "period",
        width: 7,
        rank: 6,
        text: |row| micros(row.plan.period_us),
    },
    Column {
        name: "duration",
        width: 8,
        rank: 5,
        text: |row| micros(row.plan.duration_us),
    },
    Column {
        name: "executed",
        width: 10,
        rank: 4,
        text: |row| row.counted.executed.to_string(),
    },
    Column {
        name: "rate",
        width: 7,
        rank: 8,
        text: |row| hertz(row.rate_hz),
    },
    Column {
        name: "overruns",
        width: 8,
        rank: 1,
        text: |row| row.counted.overruns.to_string(),
    },
    Column {
        name: "missed",
        width: 6,
        rank: 1,
        text: |row| row.counted.missed.to_string(),
    },
    Column {
        name: "shortest",
        width: 8,
        rank: 10,
        text: |row| Ns(row.counted.shortest_execution_ns.into()).to_string(),
    },
    Column {
        name: "mean",
        width: 7,
        rank: 7,
        text: |row| Ns(row.counted.mean_execution_ns).to_string(),
    },
    Column {
        name: "longest",
        width: 7,
        rank: 3,
        text: |row| Ns(row.counted.longest_execution_ns.into()).to_string(),
    },
    Column {
        name: "mean%",
        width: 6,
        rank: 9,
        text: |row| percent(Some(row.mean_share())),
    },
    Column {
        name: "most%",
        width: 6,
        rank: 2,
        text: |row| percent(Some(row.longest_share())),
    },
    Column {
        name: "soonest",
        width: 7,
        rank: 11,
        text: |row| Ns(row.counted.shortest_delay_ns.into()).to_string(),
    },
    Column {
        name: "latest",
        width: 7,
        rank: 2,
        text: |row| Ns(row.counted.longest_delay_ns.into()).to_string(),
    },
];

fn micros(us: u32) -> String {
    const NS_PER_US: u64 = 1_000;
    Ns(u64::from(us) * NS_PER_US).to_string()
}

/// The columns that fit into so many, the less important ones left out.
fn columns_for(width: u16) -> Vec<&'static Column> {
    let mut by_rank: Vec<&Column> = COLUMNS.iter().collect();
    by_rank.sort_by_key(|column| column.rank);
    let mut used = 0;
    // Behind the first one that does not fit, none is looked at: so columns go in their order as a
    // screen shrinks.
    let fitting = by_rank.iter().take_while(|column| {
        used += column.width + 1;
        used <= width + 1
    });
    let greatest_rank = fitting.map(|column| column.rank).max().unwrap_or(0);
    let mut columns: Vec<&Column> = COLUMNS
        .iter()
        .filter(|column| column.rank <= greatest_rank)
        .collect();
    let mut width_of_all: u16 = columns.iter().map(|column| column.width + 1).sum();
    while width_of_all > width + 1 {
        let Some(last) = columns.pop() else { break };
        width_of_all -= last.width + 1;
    }
    columns
}

fn draw_table(frame: &mut Frame<'_>, area: Rect, view: &View, rows: &[SlotRow], palette: Palette) {
    let title: Cow<'_, str> = match view.counted_from_us() {
        Some(us) => {
            let seconds = us as f64 / 1e6;
            format!(" slots, counted from {seconds:.1} s on (shortest and longest from the start) ")
                .into()
        }
        None => " slots ".into(),
    };
    let block = Block::new().borders(Borders::TOP).title(title);
    if rows.is_empty() {
        let text = if view.reading().is_some() {
            "The robot has no mission: esm upload FILE --port P gives it one."
        } else {
            "Reading…"
        };
        let text = Paragraph::new(text).wrap(Wrap { trim: true });
        frame.render_widget(text.block(block), area);
        return;
    }
    let columns = columns_for(area.width);
    let head = Row::new(
        columns
            .iter()
            .map(|column| Line::raw(column.name).right_aligned()),
    )
    .style(Style::new().add_modifier(Modifier::UNDERLINED));
    let lines = rows.iter().map(|row| {
        let style = match row {
            _ if row.counted.overruns > 0 || row.counted.missed > 0 => palette.bad(),
            _ if row.longest_share() > NEARLY_FULL => palette.warning(),
            _ => Style::new(),
        };
        let cells = columns
            .iter()
            .map(|column| Cell::from(Line::raw((column.text)(row)).right_aligned()));
        Row::new(cells).style(style)
    });
    let widths = columns
        .iter()
        .map(|column| Constraint::Length(column.width));
    let table = Table::new(lines, widths)
        .header(head)
        .block(block)
        .row_highlight_style(Style::new().add_modifier(Modifier::REVERSED));
    let mut state = TableState::new().with_selected(view.selected());
    frame.render_stateful_widget(table, area, &mut state);
}

/// The nets, a line each; where there is not room for all, how many are left out.
fn draw_nets(frame: &mut Frame<'_>, area: Rect, view: &View, palette: Palette) {
    let nets = view.nets();
    let room = usize::from(area.height.saturating_sub(1));
    let title = match nets.len().saturating_sub(room) {
        0 => " nets ".to_owned(),
        left_out => format!(" nets, {left_out} more below "),
    };
    let block = Block::new().borders(Borders::TOP).title(title);
    let width = nets.iter().map(|net| net.name.chars().count()).max();
    let width = width.unwrap_or_default();
    let lines: Vec<Line<'_>> = nets
        .iter()
        .map(|net| {
            let (value, style) = match &net.value {
                Some(value) => (value.as_str(), Style::new()),
                None => ("nothing yet", palette.quiet()),
            };
            Line::from(vec![
                Span::raw(format!(" {:<width$}  ", net.name)),
                Span::styled(value.to_owned(), style),
            ])
        })
        .collect();
    frame.render_widget(Paragraph::new(lines).block(block), area);
}

/// A longest execution of more than this share of the slot's duration is shown as a warning.
const NEARLY_FULL: f64 = 0.9;

fn draw_delays(frame: &mut Frame<'_>, area: Rect, row: Option<&SlotRow>, palette: Palette) {
    let title = match row {
        Some(row) => format!(" start delays of slot {} ", row.plan.number),
        None => " start delays ".to_owned(),
    };
    let block = Block::new().borders(Borders::TOP).title(title);
    let buckets = row.map_or(&[] as &[DelayBucket], |row| &row.counted.delays);
    let most = buckets.iter().map(|bucket| bucket.count).max().unwrap_or(0);
    let lines: Vec<Line<'_>> = buckets
        .iter()
        .map(|bucket| {
            let end = match bucket.below_ns {
                Some(end) => format!("<{}", Ns(end)),
                None => "more".to_owned(),
            };
            Line::from(vec![
                Span::raw(format!("{end:>9} {:>10} ", bucket.words())),
                Span::styled(bar(bucket.count, most), palette.of(Color::Cyan)),
            ])
        })
        .collect();
    frame.render_widget(Paragraph::new(lines).block(block), area);
}

/// A bar for a count beside the greatest one; whatever has happened shows.
fn bar(count: u32, most: u32) -> String {
    let eighths = u64::from(count) * BAR_COLUMNS as u64 * 8 / u64::from(most.max(1));
    let eighths = if count > 0 { eighths.max(1) } else { 0 } as usize;
    const PARTS: [&str; 8] = ["", "▏", "▎", "▍", "▌", "▋", "▊", "▉"];
    let part = PARTS.get(eighths % 8).copied().unwrap_or_default();
    "█".repeat(eighths / 8) + part
}

fn draw_tasks(frame: &mut Frame<'_>, area: Rect, view: &View, palette: Palette) {
    let block = Block::new().borders(Borders::TOP).title(" its tasks ");
    let lines: Vec<Line<'_>> = view
        .tasks()
        .map(|task| match task.counted {
            Some(counted) => {
                let told = TopTask {
                    path: task.plan.path.clone(),
                    task: task.plan.task.clone(),
                    enabled: counted.enabled,
                    busy: counted.busy,
                    overruns: counted.overruns,
                };
                let style = match (counted.overruns > 0, counted.busy, counted.enabled) {
                    (true, _, _) => palette.bad(),
                    (_, true, _) => palette.warning(),
                    (_, _, true) => Style::new(),
                    _ => palette.quiet(),
                };
                Line::styled(told.to_string(), style)
            }
            None => Line::styled(
                format!("{} ({})", task.plan.path, task.plan.task),
                palette.quiet(),
            ),
        })
        .collect();
    frame.render_widget(Paragraph::new(lines).block(block), area);
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use esm_link::message::{Mode, SafeReason};
    use ratatui::buffer::Buffer;

    use super::super::report::TopReport;
    use super::super::view::tests::{reading, reading_of, robot, view_of};
    use super::super::view::{Key, NetRow};
    use super::*;
    use crate::cli::status::StatusReport;
    use crate::cli::terminal::tests::{self as terminal, assert_golden, coloured, text};
    use crate::reading::Reading;

    fn drawn(view: &View, width: u16, height: u16, colour: bool) -> Buffer {
        terminal::drawn(width, height, |frame| draw(frame, view, Palette { colour }))
    }

    #[test]
    fn the_screen_is_as_it_was_when_it_was_looked_at() {
        let running = || view_of(&[100, 150]);
        let mut second_slot = running();
        second_slot.press(Key::Down);
        let mut reset = running();
        reset.press(Key::Reset);
        reset.take(reading(180));
        let mut lost = running();
        lost.press(Key::Pause);
        lost.set_time(Duration::from_secs(3));
        lost.lost("the line to the robot is lost".to_owned());
        lost.set_time(Duration::from_secs(7));
        let mut safe = reading(200);
        safe.status.mode = Mode::Safe(SafeReason::Overruns);
        let mut in_safe_state = View::new(robot());
        in_safe_state.take(safe);
        let mut empty = reading(1).status;
        (empty.mode, empty.mission) = (Mode::Empty, None);
        let mut without_mission = View::new(robot());
        without_mission.take(Reading::without_mission(empty, 300_000));
        let net = |name: &str, value: Option<&str>| NetRow {
            name: name.to_owned(),
            value: value.map(str::to_owned),
        };
        let mut with_nets = running();
        with_nets.take_nets(vec![
            net(
                "position/Track.pose",
                Some("x 1.250 m  y -0.031 m  heading 0.120 rad"),
            ),
            net(
                "motion/Ahead.twist",
                Some("forward 0.250 m/s  turn 0.000 rad/s"),
            ),
            net("power/Measure.battery", None),
        ]);
        for (name, view, width, height) in [
            ("nets", with_nets, 100, 24),
            ("wide", running(), 132, 24),
            ("usual", second_slot, 80, 24),
            ("reset", reset, 120, 20),
            ("lost", lost, 100, 18),
            ("safe", in_safe_state, 100, 18),
            ("without_mission", without_mission, 80, 12),
            ("before_the_first_reading", View::new(robot()), 60, 8),
            ("narrow", running(), 40, 20),
            ("narrow_and_tall", running(), 60, 26),
            ("low", running(), 80, 6),
        ] {
            assert_golden("top", name, &text(&drawn(&view, width, height, false)));
        }
    }

    #[test]
    fn any_size_of_screen_can_be_drawn_on() {
        let mut view = view_of(&[100, 150]);
        view.press(Key::Down);
        for width in [1, 19, 20, 33, 60, 81, 140] {
            for height in (1..=20).chain([40]) {
                drawn(&view, width, height, true);
            }
        }
        // As long as there is any room, the slot that is looked at shows.
        for height in [3, 4, 5, 9, 17, 18, 26] {
            let screen = drawn(&view, 80, height, true);
            let reversed =
                |cell: &ratatui::buffer::Cell| cell.modifier.contains(Modifier::REVERSED);
            assert!(
                screen.content.iter().any(reversed),
                "{height} lines:\n{}",
                text(&screen)
            );
        }
    }

    #[test]
    fn columns_go_one_by_one_as_the_screen_shrinks() {
        let all = columns_for(200).len();
        assert_eq!(all, COLUMNS.len());
        let mut before = all;
        for width in (LEAST_COLUMNS..=200).rev() {
            let columns = columns_for(width);
            let used: u16 = columns.iter().map(|column| column.width + 1).sum();
            assert!(used <= width + 1, "{width} columns: {used} used");
            assert!(columns.len() <= before, "{width} columns");
            assert_eq!(columns[0].name, "slot");
            before = columns.len();
        }
    }

    /// What a robot says is whatever it likes to say.
    #[test]
    fn numbers_at_their_ends_are_shown() {
        let numbers = [0, 1, u64::from(u32::MAX), u64::MAX - 1, u64::MAX];
        for (before, now) in numbers
            .iter()
            .flat_map(|one| numbers.map(|two| (*one, two)))
        {
            let mut view = View::new(robot());
            view.take(reading_of(before));
            view.press(Key::Reset);
            view.take(reading_of(now));
            for width in [40, 80, 200] {
                drawn(&view, width, 30, false);
            }
            let reports = [
                TopReport::new(robot(), reading_of(now)).to_string(),
                StatusReport::new(robot(), reading_of(now)).to_string(),
            ];
            for said in reports {
                assert!(said.contains(&now.to_string()), "{said}");
            }
            let json = [
                serde_json::to_value(TopReport::new(robot(), reading_of(now))).unwrap(),
                serde_json::to_value(StatusReport::new(robot(), reading_of(now))).unwrap(),
            ];
            assert!(json.iter().all(|json| json["steps"] == now), "{json:?}");
        }
    }

    #[test]
    fn where_there_is_to_be_no_colour_there_is_none() {
        let view = view_of(&[100, 150]);
        let colours = |colour| coloured(&drawn(&view, 100, 24, colour));
        assert_eq!(colours(false), 0);
        assert!(colours(true) > 0);
    }

    #[test]
    fn whatever_has_happened_has_a_bar() {
        for (count, most, expected) in [
            (0, 0, ""),
            (0, 7, ""),
            (1, u32::MAX, "▏"),
            (u32::MAX, u32::MAX, "████████████████"),
            (1, 2, "████████"),
            (33, 64, "████████▎"),
        ] {
            assert_eq!(bar(count, most), expected, "{count} of {most}");
        }
    }
}
