//! What is said of links and frames, right and wrong.

use std::fmt::Write as _;
use std::time::Duration;

use super::*;
use crate::model::{Content, Direction};

/// A mission around the declarations under test, on the lines behind them.
const REST: &str = "
interpreter slot 1;
slot 1 period 10 ms duration 1 ms;
slot 2 period 10 ms duration 1 ms;
slot 3 period 20 ms duration 1 ms;
task Where slot 2 { out data pose: Pose; }
task Watch slot 2 { in data range: Range optional; }
";

/// A machine that sends and receives everything.
const MACHINE: &str = "
machine M {
  region r { task P: Where; task Q: Watch; initial -> P; P -> Q; }
  region s { task S: radio.transmit slot 3; initial -> S / set .lost; }
  region t { task R: radio.receive slot 3; state End; initial -> R; R -> End [.stop]; }
  path P.pose -> S.pose;
  path R.range -> Q.range;
}
";

/// Frames that this machine uses.
const FRAMES: &str = "frame pose 7 out on radio: Pose payload 12 bytes period 100 ms;
frame alarm 8 out on radio flags lost, low payload 1 bytes rate 20 Hz;
frame range 7 in on radio: Range payload 8 bytes period 100 ms late 150 ms;
frame orders 9 in on radio flags stop, go payload 1 bytes period 50 ms;";

/// The errors, as code, line and the first word at the place.
fn found(checked: &Checked) -> Vec<String> {
    let errors = checked
        .diagnostics
        .iter()
        .filter(|found| found.severity() == Severity::Error);
    let places = errors.map(|found| {
        let place = checked.position(found.span);
        let text = &checked.files[found.span.file as usize].text;
        let word = text[found.span.start as usize..found.span.end as usize]
            .split(' ')
            .next();
        format!("{} {} {}", found.code, place.line, word.unwrap_or_default())
    });
    places.collect()
}

/// Checks a table of texts, each with all that is said of it.
fn assert_found(cases: &[(String, &[&str])]) {
    let mut wrong = String::new();
    for (text, expected) in cases {
        let mut checked = load_text("case.esm", text);
        if !checked.has_errors() {
            checked.solve_links(Duration::from_secs(5));
        }
        if found(&checked) != *expected {
            let _ = writeln!(
                wrong,
                "── {text}\nexpected {expected:?}\nfound    {:?}\n{}",
                found(&checked),
                checked.json_lines()
            );
        }
    }
    assert!(wrong.is_empty(), "{wrong}");
}

#[test]
fn a_dispatcher_has_the_ports_and_flags_of_its_frames() {
    let text = format!("link radio rate 115200 bps;\n{FRAMES}{REST}{MACHINE}");
    let checked = load_text("radio.esm", &text);
    assert_eq!(found(&checked), [""; 0], "{}", checked.json_lines());
    let model = checked.model.unwrap();
    let link = &model.links[0];
    assert_eq!((link.header_bytes, link.bits, link.gap_us), (4, 10, 0));
    let signature = |task: usize| crate::compile::signature::text(&model.tasks[task]);
    assert_eq!(
        signature(link.transmit),
        "task radio.transmit{in data pose:Pose optional;in flag lost;in flag low;out flag pose_full;out flag alarm_full;}"
    );
    assert_eq!(
        signature(link.receive),
        "task radio.receive{out data range:Range;out flag stop;out flag go;out flag range_available;out flag range_delayed;out flag orders_available;out flag orders_delayed;out flag errors;}"
    );
    let frames: Vec<_> = model
        .frames
        .iter()
        .map(|frame| {
            (
                frame.id,
                frame.direction,
                frame.duration_us(link),
                frame.late_us(),
            )
        })
        .collect();
    // (4 + 12 + 4) · 10 bits at 115,200 bits a second are 1,736.1 us.
    assert_eq!(
        frames,
        [
            (7, Direction::Out, Some(1_737), 300_000),
            (8, Direction::Out, Some(782), 150_000),
            (7, Direction::In, Some(1_389), 150_000),
            (9, Direction::In, Some(782), 150_000),
        ]
    );
    assert_eq!(
        model.frames[1].content,
        Content::Flags(vec!["lost".into(), "low".into()])
    );
}

#[test]
fn wrong_links_and_frames_are_told_at_their_place() {
    let link = |rest: &str| format!("link radio {rest}\n{FRAMES}{REST}{MACHINE}");
    let with = |frames: &str| {
        format!("link radio rate 1 bps;\n{frames}{REST}machine M {{ region r {{ task S: radio.transmit slot 3; initial -> S; }} region t {{ task R: radio.receive slot 2; initial -> R; }} }}")
            .replace("rate 1 bps", "rate 100000 bps")
    };
    let out = "frame a 1 out on radio flags x, y";
    assert_found(&[
        (link("rate 0 bps;"), &["E014 1 0"]),
        (link("rate 100000001 bps;"), &["E014 1 100000001"]),
        (link("rate 99999999999 bps;"), &["E014 1 99999999999"]),
        (link("rate 9600 bps header 256 bytes;"), &["E014 1 256"]),
        (
            link("rate 9600 bps header 255 bytes bits 0;"),
            &["E014 1 0"],
        ),
        (link("rate 9600 bps bits 21;"), &["E014 1 21"]),
        (link("rate 9600 bps bits 20 gap 1 ms header 0 bytes;"), &[]),
        (link("rate 9600 bps bits 9 bits 8;"), &["E003 1 bits"]),
        (
            link("rate 9600 bps gap 1 ms header 3 bytes gap 2 ms;"),
            &["E003 1 gap"],
        ),
        (link("rate 9600;"), &["E001 1 ;"]),
        (link("rate 9600 bps header 4;"), &["E001 1 ;"]),
        (link("header 4 bytes;"), &["E001 1 header"]),
        (
            link("rate 9600 bps;\nlink radio rate 9600 bps;"),
            &["E003 2 radio"],
        ),
        (with(&format!("{out} payload 1 bytes period 100 ms;")), &[]),
        // Neither period nor rate, or no payload.
        (with(&format!("{out} payload 1 bytes;")), &["E001 2 ;"]),
        (with(&format!("{out} period 10 ms;")), &["E001 2 ;"]),
        (with(&format!("{out};")), &["E001 2 ;"]),
        (
            with(&format!("{out} payload 1 bytes rate 10 Hz period 100 ms;")),
            &["E003 2 period"],
        ),
        (
            with(&format!(
                "{out} payload 1 bytes payload 2 bytes period 100 ms;"
            )),
            &["E003 2 payload"],
        ),
        (
            with(&format!("{out} payload 0 bytes period 100 ms;")),
            &["E014 2 0"],
        ),
        (
            with(&format!("{out} payload 241 bytes period 100 ms;")),
            &["E014 2 241"],
        ),
        (
            with(&format!("{out} payload 240 bytes period 100 ms;")),
            &[],
        ),
        (
            with(&format!("{out} payload 1 bytes rate 3 Hz;")),
            &["E010 2 frame"],
        ),
        (
            with(&format!("{out} payload 1 bytes period 0 ms;")),
            &["E001 2 0"],
        ),
        (
            with(&format!("{out} payload 1 bytes period 100 ms late 1 s;")),
            &["E014 2 late"],
        ),
        (
            with(
                "frame a 1 out on radio flags x, y, a, b, c, d, e, f, g payload 1 bytes period 100 ms;",
            ),
            &["E014 2 1"],
        ),
        (
            with("frame a 2048 out on radio flags x, y payload 1 bytes period 100 ms;"),
            &["E014 2 2048"],
        ),
        (
            with("frame a 2047 out on radio flags x, y payload 1 bytes period 100 ms;"),
            &[],
        ),
        // One number in one direction.
        (
            with(&format!(
                "{out} payload 1 bytes period 100 ms;\nframe b 1 out on radio flags z payload 1 bytes period 1 s;"
            )),
            &["E014 3 1"],
        ),
        (
            with(&format!(
                "{out} payload 1 bytes period 100 ms;\nframe b 1 in on radio flags z payload 1 bytes period 1 s;"
            )),
            &[],
        ),
        (
            with(&format!(
                "{out} payload 1 bytes period 100 ms;\nframe a 2 out on radio flags z payload 1 bytes period 1 s;"
            )),
            &["E003 3 a"],
        ),
        // Flags that have one name.
        (
            with(&format!(
                "{out} payload 1 bytes period 100 ms;\nframe b 2 out on radio flags x payload 1 bytes period 1 s;"
            )),
            &["E003 3 x"],
        ),
        (
            with("frame a 1 out on radio flags x, y, a_full payload 1 bytes period 100 ms;"),
            &["E003 2 a_full"],
        ),
        (
            with(
                "frame b 1 out on radio flags x, y, a_full payload 1 bytes period 100 ms;\nframe a 2 out on radio: T payload 1 bytes period 1 s;",
            ),
            &["E003 3 a"],
        ),
        (
            with(&format!(
                "{out} payload 1 bytes period 100 ms;\nframe b 2 in on radio flags errors payload 1 bytes period 1 s;"
            )),
            &["E003 3 errors"],
        ),
        // Names that are not there.
        (
            with(&format!(
                "{out} payload 1 bytes period 100 ms;\nframe b 2 in on radoi flags z payload 1 bytes period 1 s;"
            )),
            &["E002 3 radoi"],
        ),
        (
            with("frame a 1 out on radio flags x payload 1 bytes period 1 s;")
                .replace("radio.transmit", "rdio.transmit"),
            &["E002 9 rdio"],
        ),
        (
            with("frame a 1 out on radio flags x payload 1 bytes period 1 s;")
                .replace("radio.transmit", "radio.send"),
            &["E001 9 send"],
        ),
        (
            with("frame a 1 out on radio flags x payload 1 bytes period 1 s;")
                .replace("S: radio.transmit", "S: radio"),
            &["E002 9 radio"],
        ),
        // A dispatcher needs a slot.
        (
            with("").replace("transmit slot 3", "transmit"),
            &["E009 9 task"],
        ),
        (
            with("").replace("transmit slot 3", "transmit slot 0"),
            &["E014 9 slot"],
        ),
        (
            with("").replace("receive slot 2", "transmit slot 2"),
            &["E014 9 task"],
        ),
    ]);
}

#[test]
fn links_and_frames_that_nobody_uses() {
    let machine = |inside: &str| format!("{REST}machine M {{ {inside} }}");
    let none = machine(
        "region r { task P: Where; task Q: Watch; initial -> P; P -> Q; } path P.pose -> Q.range;",
    )
    .replace("Pose", "Range");
    let link = "link radio rate 100000 bps;\n";
    let warned = |text: String| {
        let checked = load_text("case.esm", &text);
        let unused = checked
            .diagnostics
            .iter()
            .filter(|found| found.code == Code::W107);
        let places = unused.map(|found| {
            let place = checked.position(found.span);
            format!("{}:{}", place.line, place.col)
        });
        places.collect::<Vec<_>>()
    };
    assert_eq!(warned(format!("{link}{FRAMES}{none}")), ["1:1", "9:1"]);
    assert_eq!(warned(format!("{link}{FRAMES}{REST}{MACHINE}")), [""; 0]);
    for (from, to, expected) in [
        ("/ set .lost", "", vec!["3:1"]),
        ("[.stop]", "[.orders_delayed]", vec![]),
        ("[.stop]", "[.errors]", vec!["5:1"]),
        ("path P.pose -> S.pose;", "", vec!["2:1"]),
        ("path R.range -> Q.range;", "", vec!["4:1"]),
    ] {
        let text = format!("{link}{FRAMES}{REST}{}", MACHINE.replace(from, to));
        let of_links: Vec<_> = warned(text)
            .into_iter()
            .filter(|place| place.starts_with(['1', '2', '3', '4', '5']) && place.len() == 3)
            .collect();
        assert_eq!(of_links, expected, "{from} -> {to}");
    }
}

#[test]
fn frames_that_find_no_time() {
    let machine = format!(
        "{REST}machine M {{ region r {{ task S: radio.transmit slot 3; state Z; initial -> S; S -> Z [.a_full or .b_full]; }} }}"
    );
    // (4 + 2 + 4) · 10 bits at 100,000 bits a second are a millisecond.
    let frame = |name: &str, id: u32, period: &str| {
        format!(
            "frame {name} {id} out on radio flags {name}{name} payload 2 bytes period {period};\n"
        )
    };
    let of = |frames: [String; 2]| {
        format!("link radio rate 100000 bps;\n{}{machine}", frames.concat())
            .replace("slot 2 period 10 ms duration 1 ms;\n", "")
            .replace("slot 2", "slot 3")
    };
    let errors = |text: &str| {
        let mut checked = load_text("case.esm", text);
        checked.lay_out(Duration::from_secs(5));
        found(&checked)
    };
    for (a, b, expected) in [
        ("2 ms", "2 ms", vec![]),
        ("500 us", "2 ms", vec!["E010 2 frame"]),
        ("2 ms", "999 us", vec!["E010 3 frame"]),
        ("1 ms", "2 ms", vec!["E010 2 frame"]),
        // Each fits, and they meet.
        ("2 ms", "3 ms", vec!["E011 2 frame"]),
    ] {
        let text = of([frame("a", 1, a), frame("b", 2, b)]);
        assert_eq!(errors(&text), expected, "{a}, {b}\n{text}");
    }
}
