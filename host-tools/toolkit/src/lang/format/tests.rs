//! What the layout looks like, and the laws that it keeps whatever the text.

use proptest::prelude::*;

use super::*;
use crate::lang::lexer::{Comment, docs_text};
use crate::lang::tree::Name;
use crate::model::Span;

#[track_caller]
fn formatted(text: &str) -> String {
    format("test.esm", text.as_bytes())
        .unwrap_or_else(|refusal| panic!("{}\n{text}", refusal.render(false)))
}

/// A table of cases: a text and what it becomes.
#[track_caller]
fn become_what_is_expected(cases: &[(&str, &str)]) {
    for (text, expected) in cases {
        let found = formatted(text);
        assert_eq!(&found, expected, "of {text:?}");
        assert_eq!(formatted(&found), found, "a second time");
    }
}

#[test]
fn statements_stand_on_lines_of_their_own() {
    become_what_is_expected(&[
        ("", ""),
        ("\u{FEFF}queue 3;", "queue 3;\n"),
        (
            "use\"a.esm\";slot 1 rate 50Hz duration\t2\r\n ms;",
            "use \"a.esm\";\nslot 1 rate 50 Hz duration 2 ms;\n",
        ),
        ("machine M{}", "machine M {}\n"),
        (
            "link radio rate 9600bps gap 1ms;frame a 1 out on radio:A payload 4bytes rate 2Hz;frame b 2 in on radio flags x,y payload 1 bytes period 1s late 2 s;",
            "link radio rate 9600 bps gap 1 ms;\nframe a 1 out on radio: A payload 4 bytes rate 2 Hz;\nframe b 2 in on radio flags x, y payload 1 bytes period 1 s late 2 s;\n",
        ),
        (
            "machine M{region r{task S:radio . transmit slot 2;S->S[.near];}}",
            "machine M {\n    region r {\n        task S: radio.transmit slot 2;\n        S -> S [.near];\n    }\n}\n",
        ),
        (
            "task T slot 1{in data a:A optional;param x:f32=-1.5 min - 2 max 3;}",
            "task T slot 1 {\n    in data a: A optional;\n    param x: f32 = -1.5 min -2 max 3;\n}\n",
        ),
        (
            "machine M{region r{task A:T slot 0 with{x=1,y=true};initial->A;A->final on*;A->A[not(.a or^b)and exit]/set.c,clear^d,send E;}path A.x,r.A.y->A.z;}",
            "machine M {\n    region r {\n        task A: T slot 0 with { x = 1, y = true };\n        initial -> A;\n        A -> final on *;\n        A -> A [not (.a or ^b) and exit] / set .c, clear ^d, send E;\n    }\n\n    path A.x, r.A.y -> A.z;\n}\n",
        ),
    ]);
}

#[test]
fn one_empty_line_stays_and_blocks_are_separated() {
    become_what_is_expected(&[
        (
            "\n\nqueue 3;\n\n\n\nqueue 4;\nqueue 5;\n\n",
            "queue 3;\n\nqueue 4;\nqueue 5;\n",
        ),
        (
            "queue 3;\n// about T\ntask T {\n\n\n// inside\n\n\n}\n// behind\nqueue 4;",
            "queue 3;\n\n// about T\ntask T {\n    // inside\n}\n\n// behind\nqueue 4;\n",
        ),
        (
            "// first\ntask T {} task U {}",
            "// first\ntask T {}\n\ntask U {}\n",
        ),
        (
            "task T {}\n// of T\n\ntask U {}",
            "task T {}\n// of T\n\ntask U {}\n",
        ),
    ]);
}

#[test]
fn comments_stay_where_they_belong() {
    become_what_is_expected(&[
        (
            "// a  \r\n/* b */ /* c\n   c */queue 3;",
            "// a\n/* b */\n/* c\n   c */\nqueue 3;\n",
        ),
        (
            "queue/*a*/3// b\n;/*c*/// d\n// e",
            "queue /*a*/ 3 // b\n    ;                                   /*c*/ // d\n// e\n",
        ),
        ("task T/*a*/{/*b*/}/*c*/", "task T /*a*/ { /*b*/\n} /*c*/\n"),
        (
            "machine M { // a\n event/*b*/E,// c\n// d\nF;\n// e\n}// f",
            "machine M { // a\n    event /*b*/ E, // c\n        // d\n        F;\n    // e\n} // f\n",
        ),
        (
            "machine M{region r{state A;initial->A// a\non pulse// b\n/send E/*c*/;}}",
            "machine M {\n    region r {\n        state A;\n        initial -> A // a\n            on pulse // b\n            / send E /*c*/;\n    }\n}\n",
        ),
    ]);
}

#[test]
fn comments_behind_neighbouring_lines_share_a_column() {
    let near = |text: &str, column: usize, comment: &str| format!("{text:column$}{comment}\n");
    become_what_is_expected(&[
        (
            "queue 3; // a\nslot 1 period 1 ms duration 1 ms;\nuse \"x\"; // b",
            &(near("queue 3;", 40, "// a")
                + "slot 1 period 1 ms duration 1 ms;\n"
                + &near("use \"x\";", 40, "// b")),
        ),
        (
            "use \"a23456789012345678901234567890123456789\"; // a\nqueue 3; // b\n\nqueue 4; // c",
            &(near(
                "use \"a23456789012345678901234567890123456789\";",
                48,
                "// a",
            ) + &near("queue 3;", 48, "// b")
                + "\n"
                + &near("queue 4;", 40, "// c")),
        ),
        (
            "machine M { event E; // a\n}",
            &("machine M {\n".to_owned() + &near("    event E;", 52, "// a") + "}\n"),
        ),
    ]);
    // A line that is longer than the last column keeps its comment to itself.
    let long = format!("use \"{}\";", "x".repeat(90));
    become_what_is_expected(&[(
        &format!("{long} // a\nqueue 3; // b"),
        &(format!("{long}  // a\n") + &near("queue 3;", 40, "// b")),
    )]);
}

#[test]
fn long_statements_are_broken_where_a_person_would() {
    let source = "machine M {
    event Aaaaaaaaaaaaaaaaaaa, Bbbbbbbbbbbbbbbbbbbbbb, Cccccccccccccccccccccccc, Ddddddddddddddddddddddddd, Eeeeeeee;
    region r {
        task Aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa: Tttttttttttttttttttttttttt timeout 3 s with { speed_m_per_s = 3.5, near = 3 };
        Aaaaaaaaaaaaaaaaa -> Bbbbbbbbbbbbbbbbbbbbb on Eeeeeeeeeeeeeeee [.near and not .far or exit] / send F, set .left;
        A -> B [.aaaaaaaaaaaaaaaaaaaaaaaaaaaa and .bbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbb and not .ccccccccccccccccc or (.d and exit)];
    }
    path Aaaaaaaaaaaaaaaa.twist, Bbbbbbbbbbbbbbbbbbbbbbb.twist, Cccccccccccccccccccccc.twist, Ddddddddddddd.twist -> Eeeeee.twist, Ff.twist;
}";
    let expected = "machine M {
    event Aaaaaaaaaaaaaaaaaaa, Bbbbbbbbbbbbbbbbbbbbbb, Cccccccccccccccccccccccc,
        Ddddddddddddddddddddddddd, Eeeeeeee;

    region r {
        task Aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa: Tttttttttttttttttttttttttt timeout 3 s
            with { speed_m_per_s = 3.5, near = 3 };
        Aaaaaaaaaaaaaaaaa -> Bbbbbbbbbbbbbbbbbbbbb on Eeeeeeeeeeeeeeee
            [.near and not .far or exit]
            / send F, set .left;
        A -> B
            [.aaaaaaaaaaaaaaaaaaaaaaaaaaaa and .bbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbb
                and not .ccccccccccccccccc or (.d and exit)];
    }

    path Aaaaaaaaaaaaaaaa.twist, Bbbbbbbbbbbbbbbbbbbbbbb.twist, Cccccccccccccccccccccc.twist,
            Ddddddddddddd.twist
        -> Eeeeee.twist, Ff.twist;
}
";
    become_what_is_expected(&[(source, expected)]);
    assert!(
        expected
            .lines()
            .all(|line| line.chars().count() <= MAX_COLUMNS)
    );
}

#[test]
fn a_file_with_syntax_errors_is_refused_and_they_are_shown() {
    for text in [
        &b"queue 3"[..],
        b"machine M {",
        b"/* open",
        b"queue 3; \xFF",
        b"@",
    ] {
        let refusal = format("wrong.esm", text).unwrap_err();
        assert!(refusal.render(false).contains("wrong.esm:1:"), "{text:?}");
    }
    // What is wrong with its names is no matter of layout.
    assert_eq!(
        formatted("task T slot 1 slot 2 {} task T {}"),
        "task T slot 1 slot 2 {}\n\ntask T {}\n"
    );
}

// ─── Laws ────────────────────────────────────────────────────────────────────────────────────────

/// Tokens and comments of a text, in order; of a comment what counts, without the blanks at the
/// ends of its lines.
fn substance(text: &str) -> Vec<(Option<T>, String)> {
    let mut lexer = Lexer::new(text);
    let mut substance = Vec::new();
    let mut start = 0;
    loop {
        let token = lexer.next_token();
        let is_end = token.kind == T::EndOfFile;
        let end = if is_end {
            text.len()
        } else {
            token.start as usize
        };
        for Comment { text, .. } in Comments::new(&text[start..end]) {
            let lines: Vec<&str> = lines::comment_lines(text).collect();
            substance.push((None, lines.join("\n")));
        }
        if is_end {
            return substance;
        }
        start = token.end as usize;
        substance.push((
            Some(token.kind),
            text[token.start as usize..start].to_owned(),
        ));
    }
}

/// What the `///` lines say, by what they describe.
fn descriptions(text: &str) -> Vec<String> {
    let checked = crate::lang::load_text("test.esm", text);
    let mut found = Vec::new();
    let mut add = |name: Option<Name>, lines: Option<Span>| {
        let part = |span: Span| &text[span.start as usize..span.end as usize];
        if let Some(lines) = lines {
            let name = name.map_or("", |name| part(name.0));
            found.push(format!("{name}: {}", docs_text(part(lines))));
        }
    };
    for file in checked.trees() {
        for slot in &file.slots {
            add(slot.number.map(|number| Name(number.span)), slot.docs);
        }
        for task in &file.tasks {
            add(task.name, task.docs);
            for port in &task.data {
                add(port.name, port.docs);
            }
            for flag in &task.flags {
                add(flag.name, flag.docs);
            }
            for param in &task.params {
                add(param.name, param.docs);
            }
        }
        for container in &file.containers {
            add(container.name, container.docs);
            for event in &container.events {
                add(event.name, event.docs);
            }
            for port in &container.data {
                add(port.name, port.docs);
            }
            for flag in &container.flags {
                add(flag.name, flag.docs);
            }
            for region in &container.regions {
                add(region.name, region.docs);
                for state in &region.states {
                    add(state.name, state.docs);
                }
            }
        }
    }
    found
}

/// A text of the whole grammar, to be sprayed.
const EVERYTHING: &str = "use \"a.esm\"; interpreter slot 1; queue 32; slot 1 period 10 ms duration 1 ms; slot 2 rate 100 Hz duration 1 ms;
task Cruise slot 2 wcet 100 us exclusive motion count 2 endless { in data ranges : Ranges optional within 20 ms; inout data x : X within 1 s; in flag left; out flag near;
  param speed : f32 = -0.25 min -1 max 0.5; param on_ : bool; }
container Avoid { in event Go; out event Done; event A, B, Cc; in flag left; out data twist : Twist;
  region steps { state A timeout 3 s; task B : Cruise slot 0 timeout 1 s with { speed = 0.3, on_ = true }; super C : D timeout 1 ms;
    initial -> A; A -> B on pulse [ exit and not ( .near or ^left ) or timeout ] / send A, set .left, clear ^left; B -> final on *; }
  path steps . B . twist, C . twist -> twist, A . x; }
machine M { event Aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa, Bbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbb, Ccccccccccccccccccccccc, D;
  region r { Aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa -> Bbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbb [ .ccccccccccccccccccc and .d ] / send D; }
  path A . x, B . x -> C . x; }";

/// What may stand between two tokens; the empty one becomes a blank.
fn noise() -> impl Strategy<Value = String> {
    prop_oneof![
        12 => Just(" ".to_owned()),
        3 => "[ \t\n]{1,5}",
        1 => Just("\r\n".to_owned()),
        1 => "[ \n]{1,2}// ?[a-z/* \t]{0,12}\r?\n[ \n]{0,3}",
        1 => Just("\n/// One.\n  ///  Two.\n".to_owned()),
        1 => "[ \n]{1,2}/\\* ?[a-z/ \t\n]{0,9} \\*/[ \n]{0,3}",
        1 => Just(" /* one */ /* two */ // three\n\n\n// four \n".to_owned()),
    ]
}

proptest! {
    #[test]
    fn what_a_file_says_stays_and_a_second_time_changes_nothing(
        noises in prop::collection::vec(noise(), 400),
        kept in 0_usize..300,
    ) {
        // A part of the text stays as it is, so that there are long statements without noise in
        // them.
        let words: Vec<&str> = EVERYTHING.split_whitespace().collect();
        let mut text = noises.last().cloned().unwrap_or_default();
        for (index, (word, noise)) in words.iter().zip(&noises).enumerate() {
            text.push_str(word);
            text.push_str(if index % 97 < kept % 97 { " " } else { noise });
        }
        let found = formatted(&text);
        prop_assert_eq!(substance(&found), substance(&text), "{}", text);
        prop_assert_eq!(&formatted(&found), &found, "of\n{}", text);
        prop_assert!(!found.contains(" \n"), "{}", found);
        prop_assert_eq!(descriptions(&found), descriptions(&text), "{}", text);
    }
}
