//! What people write who know other tools: each guess beside what is right, and a part of what they
//! are told.

/// A mission without a mistake. Guesses replace parts of it.
pub const MISSION: &str = "interpreter slot 1;
slot 1 period 10 ms duration 1 ms;
slot 2 rate 100 Hz duration 4 ms;
queue 16;

task Cruise slot 2 wcet 1 ms {
    out data twist: Twist;
    out flag near;
    out flag blocked;
    in flag fast;
    param speed: f32 = 0.5 min 0.0 max 1.0;
    param careful: bool = false;
}

task Motor slot 2 {
    in data twist: Twist within 100 ms;
    out flag stuck;
}

container Turn {
    out event Turned;
    in flag left;
    out flag seen;

    region steps {
        state Wait timeout 2 s;
        state Over timeout 1500 ms;

        initial -> Wait;
        Wait -> Over [timeout and ^left] / set ^seen;
        Over -> final [timeout] / send Turned, clear ^seen;
    }
}

machine Rover {
    event Halt, Turned;

    region motion {
        task Ahead: Cruise timeout 5 s with { speed = 0.25, careful = true };
        task Back: Cruise;
        super Away: Turn timeout 9 s;
        state Stand timeout 1 s;

        initial -> Ahead / set .fast;
        Ahead -> Away [timeout] / set .left;
        Ahead -> Stand on Halt;
        Back -> Ahead [.near and not .blocked];
        Away -> Back [timeout or .seen];
        Away -> Stand on Turned;
        Stand -> Back [timeout] / send Halt, clear .fast;
    }

    region wheels {
        task Drive: Motor;

        initial -> Drive;
        Drive -> Drive [.stuck] / send Halt;
    }

    region spare {
        task Idle: Cruise;

        initial -> Idle;
        Idle -> Idle on *;
    }

    path Ahead.twist, Back.twist -> Drive.twist;
}
";

/// A guess.
pub struct Guess {
    /// What is right, as it stands in the mission.
    pub right: &'static str,
    /// What is written instead.
    pub wrong: &'static str,
    /// What message and hint must contain.
    pub told: &'static str,
    /// Whether a change of the text is offered that leaves nothing wrong.
    pub has_fix: bool,
}

const fn guess(right: &'static str, wrong: &'static str, told: &'static str) -> Guess {
    Guess {
        right,
        wrong,
        told,
        has_fix: true,
    }
}

/// A guess whose cure only a person can choose.
const fn words_only(right: &'static str, wrong: &'static str, told: &'static str) -> Guess {
    Guess {
        right,
        wrong,
        told,
        has_fix: false,
    }
}

impl Guess {
    /// The mission with the guess in it.
    pub fn text(&self) -> String {
        assert!(MISSION.contains(self.right), "{}", self.right);
        MISSION.replacen(self.right, self.wrong, 1)
    }
}

/// All guesses.
pub const GUESSES: &[Guess] = &[
    // Limits of time.
    guess(
        "Ahead -> Away [timeout]",
        "Ahead -> Away on timeout",
        "write `[timeout]`",
    ),
    guess(
        "Ahead -> Away [timeout]",
        "Ahead -> Away timeout",
        "stands in brackets",
    ),
    guess(
        "Ahead -> Away [timeout]",
        "Ahead -> Away after 5 s",
        "state A timeout 5 s",
    ),
    guess(
        "Ahead -> Away [timeout]",
        "Ahead -> Away on after 5 s",
        "[timeout]",
    ),
    guess(
        "Ahead -> Away [timeout]",
        "Ahead -> Away after(5 s)",
        "[timeout]",
    ),
    guess(
        "Ahead -> Away [timeout]",
        "Ahead -> Away [after 5 s]",
        "[timeout]",
    ),
    guess(
        "Ahead -> Away [timeout]",
        "Ahead -> Away [timeout > 5 s]",
        "[timeout]",
    ),
    guess(
        "Ahead -> Away [timeout]",
        "Ahead -> Away timeout 5 s",
        "[timeout]",
    ),
    guess(
        "Ahead -> Away [timeout]",
        "Ahead -> Away on 5 s",
        "[timeout]",
    ),
    guess(
        "Ahead -> Away [timeout]",
        "Ahead -> Away when timeout",
        "stands in brackets",
    ),
    guess(
        "state Stand timeout 1 s;",
        "state Stand after 1 s;",
        "did you mean `timeout`?",
    ),
    guess(
        "state Stand timeout 1 s;",
        "state Stand timeout(1 s);",
        "without parentheses",
    ),
    guess(
        "state Stand timeout 1 s;",
        "state Stand timeout = 1 s;",
        "no sign",
    ),
    guess(
        "state Stand timeout 1 s;",
        "state Stand timeout 1;",
        "`us`, `ms` or `s`",
    ),
    guess(
        "state Stand timeout 1 s;",
        "state Stand timeout 1 sec;",
        "`us`, `ms` or `s`",
    ),
    guess(
        "state Stand timeout 1 s;",
        "state Stand timeout 1 seconds;",
        "`us`, `ms` or `s`",
    ),
    guess(
        "state Stand timeout 1 s;",
        "state Stand timeout 1000 millis;",
        "`us`, `ms` or `s`",
    ),
    guess(
        "state Stand timeout 1 s;",
        "state Stand timeout 1 S;",
        "`us`, `ms` or `s`",
    ),
    guess(
        "state Stand timeout 1 s;",
        "state Stand timeout 1.0 s;",
        "whole number",
    ),
    guess(
        "state Over timeout 1500 ms;",
        "state Over timeout 1.5 s;",
        "whole number",
    ),
    guess(
        "state Stand timeout 1 s;",
        "state Stand;",
        "has no limit of time",
    ),
    guess(
        "Away: Turn timeout 9 s;",
        "Away: Turn;",
        "has no limit of time",
    ),
    // Flags and guards.
    guess(
        "Idle -> Idle on *",
        "Idle -> Idle on exit",
        "write `[exit]`",
    ),
    guess(
        "Idle -> Idle on *",
        "Idle -> Idle on * [exit]",
        "takes no guard",
    ),
    guess(
        "Drive -> Drive [.stuck]",
        "Drive -> Drive [Drive.stuck]",
        "state that is left",
    ),
    words_only("[.near and not .blocked]", "[Drive.stuck]", "`on E` here"),
    words_only(
        "[.near and not .blocked]",
        "[.near and .stuck]",
        "flag of state `Drive`",
    ),
    guess(
        "[.near and not .blocked]",
        "[near and not .blocked]",
        "write `.near`",
    ),
    guess(
        "[.near and not .blocked]",
        "[.near && not .blocked]",
        "write `and`",
    ),
    guess(
        "[.near and not .blocked]",
        "[.near && !.blocked]",
        "write `and`",
    ),
    guess(
        "[.near and not .blocked]",
        "[.near &&!.blocked]",
        "write `and not`",
    ),
    guess(
        "[.near and not .blocked]",
        "[.near & not .blocked]",
        "write `and`",
    ),
    guess(
        "[.near and not .blocked]",
        "[.near AND not .blocked]",
        "write `and`",
    ),
    guess(
        "[.near and not .blocked]",
        "[.near and !.blocked]",
        "write `not`",
    ),
    guess(
        "[.near and not .blocked]",
        "[.near and NOT .blocked]",
        "write `not`",
    ),
    guess(
        "[.near and not .blocked]",
        "[.near and .blocked == false]",
        "[not .f]",
    ),
    guess(
        "[.near and not .blocked]",
        "[.near == true and not .blocked]",
        "its name alone",
    ),
    guess(
        "[.near and not .blocked]",
        "[.near and .blocked != true]",
        "[not .f]",
    ),
    guess(
        "[.near and not .blocked]",
        "[.near = 1 and not .blocked]",
        "its name alone",
    ),
    words_only(
        "[.near and not .blocked]",
        "[.near > 3 and not .blocked]",
        "let a task compare",
    ),
    guess(
        "[.near and not .blocked]",
        "[.near and not ^blocked]",
        "nothing is around a machine",
    ),
    guess(
        "[.near and not .blocked]",
        ".near and not .blocked",
        "stands in brackets",
    ),
    guess(
        "[.near and not .blocked]",
        "if .near and not .blocked",
        "stands in brackets",
    ),
    guess(
        "[.near and not .blocked]",
        "when (.near and not .blocked)",
        "stands in brackets",
    ),
    guess(
        "[.near and not .blocked]",
        "if [.near and not .blocked]",
        "stands in brackets",
    ),
    guess(
        "[.near and not .blocked]",
        "on .near and not .blocked",
        "stands in brackets",
    ),
    guess(
        "[.near and not .blocked]",
        "on [.near and not .blocked]",
        "a guard stands alone",
    ),
    guess("[.near and not .blocked]", "[.near and not .blocked", "`]`"),
    guess(
        "[.near and not .blocked]",
        "[.naer and not .blocked]",
        "did you mean `near`?",
    ),
    guess("[timeout or .seen]", "[timeout || .seen]", "write `or`"),
    guess("[timeout or .seen]", "[timeout | .seen]", "write `or`"),
    guess(
        "[timeout or .seen]",
        "[TIMEOUT or .seen]",
        "did you mean `timeout`?",
    ),
    guess(
        "[timeout or .seen]",
        "[timeout or ^seen]",
        "nothing is around a machine",
    ),
    guess("[timeout and ^left]", "[timeout and .left]", "simple state"),
    guess(
        "Ahead -> Stand on Halt;",
        "Ahead -> Stand on Halt [];",
        "no brackets",
    ),
    guess(
        "Ahead -> Stand on Halt;",
        "Ahead -> Stand on Halt else;",
        "is taken where theirs",
    ),
    words_only(
        "Ahead -> Stand on Halt;",
        "Ahead -> Stand on Halt or Turned;",
        "one event",
    ),
    // Events.
    guess("Ahead -> Stand on Halt;", "Ahead -> Stand Halt;", "on Halt"),
    guess(
        "Ahead -> Stand on Halt;",
        "Ahead -> Stand: Halt;",
        "behind `on`",
    ),
    guess(
        "Ahead -> Stand on Halt;",
        "Ahead -> Stand when Halt;",
        "behind `on`",
    ),
    guess(
        "Ahead -> Stand on Halt;",
        "Ahead -> Stand event Halt;",
        "write `on`",
    ),
    guess(
        "Ahead -> Stand on Halt;",
        "Ahead -> Stand on Halt();",
        "no values",
    ),
    guess(
        "Ahead -> Stand on Halt;",
        "Ahead -> Stand on \"Halt\";",
        "without quotes",
    ),
    guess(
        "Ahead -> Stand on Halt;",
        "Ahead -> Stand on halt;",
        "did you mean `Halt`?",
    ),
    guess("event Halt, Turned;", "event Turned;", "declare it"),
    guess("event Halt, Turned;", "event Halt Turned;", "`,` or `;`"),
    guess(
        "event Halt, Turned;",
        "events Halt, Turned;",
        "did you mean `event`?",
    ),
    guess(
        "event Halt, Turned;",
        "Event Halt, Turned;",
        "did you mean `event`?",
    ),
    guess(
        "event Halt, Turned;",
        "event Halt, Turned, Idle;",
        "neither sent nor received",
    ),
    // Arrows.
    guess(
        "Ahead -> Stand on Halt;",
        "Ahead => Stand on Halt;",
        "an arrow is written `->`",
    ),
    guess(
        "Ahead -> Stand on Halt;",
        "Ahead --> Stand on Halt;",
        "an arrow is written `->`",
    ),
    guess(
        "Ahead -> Stand on Halt;",
        "Ahead ->> Stand on Halt;",
        "an arrow is written `->`",
    ),
    guess(
        "Ahead -> Stand on Halt;",
        "Ahead - > Stand on Halt;",
        "an arrow is written `->`",
    ),
    guess(
        "Ahead -> Stand on Halt;",
        "Ahead \u{2192} Stand on Halt;",
        "an arrow is written `->`",
    ),
    guess(
        "Ahead -> Stand on Halt;",
        "Ahead > Stand on Halt;",
        "an arrow is written `->`",
    ),
    guess(
        "Ahead -> Stand on Halt;",
        "transition Ahead -> Stand on Halt;",
        "`A -> B;`",
    ),
    guess(
        "Ahead -> Stand on Halt;",
        "from Ahead to Stand on Halt;",
        "`A -> B;`",
    ),
    guess(
        "Ahead -> Stand on Halt;",
        "Ahead to Stand on Halt;",
        "`A -> B;`",
    ),
    guess(
        "Ahead -> Stand on Halt;",
        "Ahead -> Stand.x on Halt;",
        "its own region",
    ),
    guess(
        "Ahead -> Stand on Halt;",
        "Ahead -> \"Stand\" on Halt;",
        "without quotes",
    ),
    guess(
        "Ahead -> Stand on Halt;",
        "Ahead -> Stnad on Halt;",
        "did you mean `Stand`?",
    ),
    guess(
        "initial -> Drive;",
        "initial Drive;",
        "an arrow is written `->`",
    ),
    guess("initial -> Drive;", "-> Drive;", "initial -> A"),
    guess("initial -> Drive;", "[*] -> Drive;", "initial -> A"),
    guess("initial -> Drive;", "[*] --> Drive;", "initial -> A"),
    guess(
        "initial -> Drive;",
        "start -> Drive;",
        "did you mean `initial`?",
    ),
    guess(
        "initial -> Drive;",
        "Initial -> Drive;",
        "did you mean `initial`?",
    ),
    guess("initial -> Drive;", "", "initial -> Drive;"),
    guess("Over -> final [", "Over -> [*] [", "-> final"),
    guess("Over -> final [", "Over -> exit [", "-> final"),
    guess("Over -> final [", "Over -> end [", "did you mean `final`?"),
    guess(
        "Over -> final [",
        "Over -> Final [",
        "did you mean `final`?",
    ),
    // Actions.
    guess(
        "/ send Halt, clear .fast;",
        "send Halt, clear .fast;",
        "behind `/`",
    ),
    guess(
        "/ send Halt, clear .fast;",
        "/ send Halt; clear .fast;",
        "separated by `,`",
    ),
    guess(
        "/ send Halt, clear .fast;",
        "/ send Halt clear .fast;",
        "separated by `,`",
    ),
    guess(
        "/ send Halt, clear .fast;",
        "/ send Halt and clear .fast;",
        "separated by `,`",
    ),
    guess(
        "/ send Halt, clear .fast;",
        "/ raise Halt, clear .fast;",
        "did you mean `send`?",
    ),
    guess(
        "/ send Halt, clear .fast;",
        "/ Halt, clear .fast;",
        "send Halt",
    ),
    guess(
        "/ send Halt, clear .fast;",
        "/ send Halt(), clear .fast;",
        "no values",
    ),
    guess(
        "/ send Halt, clear .fast;",
        "/ send Halt, reset .fast;",
        "did you mean `clear`?",
    ),
    guess(
        "/ send Halt, clear .fast;",
        "/ send Halt, not .fast;",
        "write `clear`",
    ),
    guess(
        "/ send Halt, clear .fast;",
        "/ send Halt, clear fast;",
        "write `.fast`",
    ),
    guess(
        "/ send Halt, clear .fast;",
        "/ send Halt, clear .fast,;",
        "behind the last action",
    ),
    guess(
        "/ send Halt, clear .fast;",
        "do send Halt, clear .fast;",
        "behind `/`",
    ),
    guess(
        "/ send Halt, clear .fast;",
        "/ SEND Halt, clear .fast;",
        "did you mean `send`?",
    ),
    guess(
        "initial -> Ahead / set .fast;",
        "initial -> Ahead / .fast = true;",
        "`set .f`",
    ),
    guess(
        "initial -> Ahead / set .fast;",
        "initial -> Ahead / set .fast = true;",
        "stand for the value",
    ),
    guess(
        "initial -> Ahead / set .fast;",
        "initial -> Ahead / set Ahead.fast;",
        "entered",
    ),
    guess(
        "initial -> Ahead / set .fast;",
        "initial -> Ahead / set .fast, set .near;",
        "only the task sets it",
    ),
    guess(
        "initial -> Ahead / set .fast;",
        "initial -> Ahead / set .fast, clear .near;",
        "only the task sets it",
    ),
    words_only("/ send Halt, clear .fast;", "{ send Halt; }", "behind `/`"),
    words_only(
        "initial -> Drive;",
        "initial -> Drive; entry / send Halt;",
        "no actions of its own",
    ),
    words_only(
        "initial -> Drive;",
        "initial -> Drive; exit: send Halt;",
        "no actions of its own",
    ),
    // States.
    guess(
        "state Stand timeout 1 s;",
        "State Stand timeout 1 s;",
        "did you mean `state`",
    ),
    guess(
        "state Stand timeout 1 s;",
        "STATE Stand timeout 1 s;",
        "did you mean `state`",
    ),
    guess(
        "state Stand timeout 1 s;",
        "state Stand timeout 1 s { }",
        "a state has no body",
    ),
    guess(
        "state Stand timeout 1 s;",
        "state Stand timeout 1 s",
        "a `;` is missing at the end of this line",
    ),
    guess(
        "state Stand timeout 1 s;",
        "state \"Stand\" timeout 1 s;",
        "without quotes",
    ),
    words_only(
        "state Stand timeout 1 s;",
        "state Stand timeout 1 s { entry / send Halt; }",
        "a state has no body",
    ),
    guess(
        "task Back: Cruise;",
        "task Back Cruise;",
        "`:` and the name of a task",
    ),
    guess("task Back: Cruise;", "task Back = Cruise;", "write `:`"),
    guess("task Back: Cruise;", "super Back: Cruise;", "it is a task"),
    guess(
        "super Away: Turn timeout 9 s;",
        "task Away: Turn timeout 9 s;",
        "it is a container",
    ),
    guess(
        "task Drive: Motor;\n\n        initial -> Drive;",
        "initial task Drive: Motor;",
        "initial -> Drive;",
    ),
    guess(
        "task Drive: Motor;",
        "task Drive: Motor slot 2 slot 2;",
        "given twice",
    ),
    // Parameters and numbers.
    guess(
        "with { speed = 0.25, careful = true }",
        "{ speed = 0.25, careful = true }",
        "behind `with`",
    ),
    guess(
        "with { speed = 0.25, careful = true }",
        "with speed = 0.25, careful = true",
        "in braces",
    ),
    guess(
        "with { speed = 0.25, careful = true }",
        "with { speed: 0.25, careful = true }",
        "write `=`",
    ),
    guess(
        "with { speed = 0.25, careful = true }",
        "with { speed = 0.25; careful = true }",
        "separated by `,`",
    ),
    guess(
        "with { speed = 0.25, careful = true }",
        "with { speed = 0.25 careful = true }",
        "separated by `,`",
    ),
    guess(
        "with { speed = 0.25, careful = true }",
        "with { speed = 0.25, careful = true, }",
        "behind the last value",
    ),
    guess(
        "with { speed = 0.25, careful = true }",
        "with { speed = 0.25 m/s, careful = true }",
        "no unit",
    ),
    guess(
        "with { speed = 0.25, careful = true }",
        "with { speed = 0.25 m, careful = true }",
        "no unit",
    ),
    guess(
        "with { speed = 0.25, careful = true }",
        "with { speed = .25, careful = true }",
        "both sides",
    ),
    guess(
        "with { speed = 0.25, careful = true }",
        "with { speed = 1., careful = true }",
        "both sides",
    ),
    guess(
        "with { speed = 0.25, careful = true }",
        "with { speed = +0.25, careful = true }",
        "no sign",
    ),
    guess(
        "with { speed = 0.25, careful = true }",
        "with { speed = 2.5, careful = true }",
        "from 0 to 1",
    ),
    guess(
        "with { speed = 0.25, careful = true }",
        "with { speed = 0.25, careful = True }",
        "write `true`",
    ),
    guess(
        "with { speed = 0.25, careful = true }",
        "with { speed = 0.25, careful = 1 }",
        "`true` or `false`",
    ),
    guess(
        "with { speed = 0.25, careful = true }",
        "with { sped = 0.25, careful = true }",
        "did you mean `speed`?",
    ),
    guess(
        "param speed: f32 = 0.5 min 0.0 max 1.0;",
        "param speed: f32 min 0.0 max 1.0;",
        "gives no value",
    ),
    guess(
        "param speed: f32 = 0.5 min 0.0 max 1.0;",
        "param speed f32 = 0.5 min 0.0 max 1.0;",
        "`:` and a type",
    ),
    guess(
        "task Cruise slot 2 wcet",
        "task Cruise slot 2 ms wcet",
        "no unit",
    ),
    guess("task Motor slot 2 {", "task Motor {", "names a slot"),
    guess(
        "slot 1 period 10 ms duration 1 ms;",
        "slot 1 period 100 Hz duration 1 ms;",
        "behind `rate`",
    ),
    guess(
        "slot 1 period 10 ms duration 1 ms;",
        "slot 1 every 10 ms duration 1 ms;",
        "did you mean `period`?",
    ),
    guess(
        "slot 1 period 10 ms duration 1 ms;",
        "slot 1 period 10 duration 1 ms;",
        "`us`, `ms` or `s`",
    ),
    guess(
        "slot 1 period 10 ms duration 1 ms;",
        "slot 1 period = 10 ms duration 1 ms;",
        "no sign",
    ),
    guess(
        "slot 1 period 10 ms duration 1 ms;",
        "slot 1 period 10 ms duration 1 ms",
        "a `;` is missing",
    ),
    guess(
        "slot 2 rate 100 Hz duration",
        "slot 2 rate 100 duration",
        "write `Hz`",
    ),
    guess(
        "slot 2 rate 100 Hz duration",
        "slot 2 rate 100 hz duration",
        "did you mean `Hz`?",
    ),
    guess(
        "slot 2 rate 100 Hz duration",
        "slot 2 rate 10 ms duration",
        "behind `period`",
    ),
    guess("queue 16;", "queue 16 ms;", "no unit"),
    guess("queue 16;", "queue = 16;", "no sign"),
    guess("queue 16;", "queue 16.0;", "whole number"),
    guess("interpreter slot 1;", "interpreter 1;", "`slot`"),
    guess("interpreter slot 1;", "slot 1;", "interpreter slot"),
    guess("interpreter slot 1;", "", "interpreter slot 1;"),
    // The rest.
    guess(
        "interpreter slot 1;",
        "interpreter slot 1; # the first",
        "starts with `//`",
    ),
    guess(
        "machine Rover {",
        "Machine Rover {",
        "did you mean `machine`?",
    ),
    guess(
        "machine Rover {",
        "MACHINE Rover {",
        "did you mean `machine`?",
    ),
    guess(
        "machine Rover {",
        "statemachine Rover {",
        "did you mean `machine`?",
    ),
    guess("machine Rover {", "machine Rover", "a `{` is missing"),
    guess("region wheels {", "region wheels", "a `{` is missing"),
    guess(
        "    path Ahead.twist, Back.twist -> Drive.twist;\n}",
        "    path Ahead.twist, Back.twist -> Drive.twist;",
        "a `}` is missing",
    ),
    guess(
        "    path Ahead.twist, Back.twist -> Drive.twist;\n}",
        "    path Ahead.twist, Back.twist -> Drive.twist;\n}}",
        "remove it",
    ),
    guess(
        "    path Ahead.twist, Back.twist -> Drive.twist;\n}",
        "    path Ahead.twist, Back.twist -> Drive.twist;\n};",
        "no `;` stands behind a body",
    ),
    guess(
        "path Ahead.twist, Back.twist -> Drive.twist;",
        "connect Ahead.twist, Back.twist -> Drive.twist;",
        "did you mean `path`?",
    ),
    guess(
        "path Ahead.twist, Back.twist -> Drive.twist;",
        "Ahead.twist, Back.twist -> Drive.twist;",
        "starts with `path`",
    ),
    guess(
        "path Ahead.twist, Back.twist -> Drive.twist;",
        "path Ahead.twist, Bak.twist -> Drive.twist;",
        "did you mean `Back`?",
    ),
    guess(
        "path Ahead.twist, Back.twist -> Drive.twist;",
        "path Ahead.twist, Back.twist -> Drive.twit;",
        "did you mean `twist`?",
    ),
    guess(
        "path Ahead.twist, Back.twist -> Drive.twist;",
        "",
        "needs data",
    ),
    guess("queue 16;", "queue 16; queue 16;", "a second `queue`"),
    guess(
        "queue 16;",
        "queue 16; slot 3 period 10 ms duration 1 ms;",
        "slot 3 is not used",
    ),
    guess(
        "queue 16;",
        "queue 16; task Idle slot 2 { in flag x; }",
        "task `Idle` is not used",
    ),
    guess(
        "state Stand timeout 1 s;",
        "state Stand timeout 1 s; state Lost; Lost -> Stand;",
        "is never entered",
    ),
];
