use esm_link::behaviours::{MAX_SCRIPT_STEPS, Reaction, Situation, Watch};

use super::*;
use crate::lang;
use crate::model::Task;

const TASKS: &str = "\
task Owner { out data made: BehaviourList; inout data list: BehaviourList optional; }
task GoTo { inout data list: BehaviourList optional; out flag failed; param x_m: f32; param y_m: f32 = 0.0 min -5.0 max 5.0; }
task TurnTo { inout data list: BehaviourList optional; out flag failed; param angle_rad: f32 = 1.5; param times: u32 = 1; param left: bool = true; }
task Other { out flag near; }
task Near { inout data list: BehaviourList optional; out flag up; }
";

fn tasks() -> Vec<Task> {
    lang::load_text("tasks.esm", TASKS).model.unwrap().tasks
}

fn script(text: &str) -> Script {
    let reading = read("a.script", text, &tasks());
    assert_eq!(reading.diagnostics, []);
    reading.script.unwrap()
}

/// Code, line and column, and message of what is wrong.
fn wrong(text: &str) -> Vec<(String, u32, u32, String)> {
    let reading = read("a.script", text, &tasks());
    assert_eq!(reading.script, None);
    let positions = lang::Positions::new(&reading.files);
    let told = reading.diagnostics.iter().map(|found| {
        let place = positions.of(found.span);
        (found.code.to_string(), place.line, place.col, found.text())
    });
    told.collect()
}

#[test]
fn a_line_is_a_behaviour_with_its_parameters_and_situations() {
    let script = script(
        "// Out, and back.\n\
         go_to x_m = 2.5, y_m = -1 unless near range_m = 0.3 -> suspend // careful\n\
         \n\
         TurnTo left = false unless stuck after_s = 2 -> insert go_to x_m = 1 unless low_battery below_v = 6.6->end\n\
         turn times = 3\n",
    );
    assert_eq!(script.steps, 3);
    let names: Vec<_> = (script.all.iter())
        .map(|step| (&*step.name, step.line))
        .collect();
    assert_eq!(
        names,
        [("GoTo", 2), ("TurnTo", 4), ("TurnTo", 5), ("GoTo", 4)]
    );
    let params = |step: usize| script.all[step].params().collect::<Vec<_>>();
    assert_eq!(params(0), [2.5_f32.to_bits(), (-1.0_f32).to_bits()]);
    assert_eq!(params(1), [1.5_f32.to_bits(), 1, 0]);
    assert_eq!(params(2), [1.5_f32.to_bits(), 3, 1]);
    let watches = |step: usize| script.all[step].watches().collect::<Vec<_>>();
    let watch = |situation, value, reaction| Watch {
        situation,
        value,
        reaction,
    };
    assert_eq!(watches(0), [watch(Situation::Near, 0.3, Reaction::Suspend)]);
    assert_eq!(
        watches(1),
        [
            watch(Situation::Stuck, 2.0, Reaction::Insert(3)),
            watch(Situation::LowBattery, 6.6, Reaction::EndScript)
        ]
    );
    let task = &tasks()[1];
    assert_eq!(script.all[0].call().task, signature_hash(task));
}

#[test]
fn a_mistake_has_a_place_a_cause_and_a_fix() {
    for (text, expected) in [
        ("go_too x_m = 1", ("E002", 1, 1, "did you mean `go_to`?")),
        ("other", ("E002", 1, 1, "it has go_to, turn_to")),
        ("owner", ("E002", 1, 1, "no behaviour `owner`")),
        ("\n go_to", ("E009", 2, 2, "write `x_m = …`")),
        (
            "go_to x_m = 1, x_n = 2",
            ("E002", 1, 16, "did you mean `x_m`?"),
        ),
        ("go_to x_m = 1, x_m = 2", ("E003", 1, 16, "given twice")),
        (
            "go_to x_m = 1, y_m = 5.1",
            ("E009", 1, 22, "it takes -5 to 5"),
        ),
        ("go_to x_m = NaN", ("E009", 1, 13, "a number is expected")),
        ("go_to x_m = inf", ("E009", 1, 13, "a number is expected")),
        (
            "turn times = 1.5",
            ("E009", 1, 14, "a whole number from 0 on"),
        ),
        ("turn left = 1", ("E009", 1, 13, "`true` or `false`")),
        ("go_to x_m 1", ("E001", 1, 7, "write `name = value`")),
        (
            "go_to x_m = 1 y_m = 2",
            ("E001", 1, 15, "between parameters stands a comma"),
        ),
        ("go_to x_m = 1,", ("E001", 1, 15, "a parameter is expected")),
        (
            "go_to x_m = 1 unless",
            ("E001", 1, 21, "a situation is missing"),
        ),
        (
            "turn unless nearr range_m = 1 -> end",
            ("E002", 1, 13, "did you mean `near`?"),
        ),
        (
            "turn unless near range = 1 -> end",
            ("E002", 1, 18, "it has range_m"),
        ),
        (
            "turn unless near -> end",
            ("E009", 1, 13, "`range_m` of `near` has no value"),
        ),
        (
            "turn unless near range_m = -1 -> end",
            ("E009", 1, 28, "from 0 on"),
        ),
        (
            "turn unless near range_m = inf -> end",
            ("E009", 1, 28, "from 0 on"),
        ),
        (
            "turn unless door_left least_m = 1.31 -> end",
            ("E009", 1, 33, "from 0 to 1.3"),
        ),
        (
            "turn unless near range_m = 1",
            (
                "E001",
                1,
                29,
                "suspend, cancel, end, flag, insert, go_on, replace",
            ),
        ),
        (
            "turn unless near range_m = 1 ->",
            ("E001", 1, 32, "a reaction is missing"),
        ),
        (
            "turn unless near range_m = 1 -> stopp",
            ("E002", 1, 33, "there is no reaction `stopp`"),
        ),
        (
            "turn unless near range_m = 1 -> insert",
            ("E001", 1, 39, "a behaviour is missing"),
        ),
        (
            "turn unless failed -> replace go_too",
            ("E002", 1, 31, "did you mean `go_to`?"),
        ),
        (
            "turn unless failed after_s = 1 -> cancel",
            ("E002", 1, 20, "it has none"),
        ),
        (
            "turn unless failed -> suspend",
            ("E009", 1, 23, "go_on with a label"),
        ),
        (
            "turn unless failed -> go_on",
            ("E001", 1, 28, "a label is missing"),
        ),
        (
            "turn unless failed -> go_on hom\nhome: turn",
            ("E002", 1, 29, "did you mean `home`?"),
        ),
        (
            "home: turn\nturn unless failed -> go_on home",
            ("E009", 2, 29, "is not behind this line"),
        ),
        (
            "a: turn unless failed -> go_on a",
            ("E009", 1, 32, "is not behind this line"),
        ),
        ("a: turn\na: turn", ("E003", 2, 1, "given twice")),
        ("turn\na:", ("E001", 2, 1, "no step stands behind")),
        ("", ("E001", 1, 1, "no step")),
        ("// nothing", ("E001", 1, 1, "no step")),
        ("\u{1}", ("E002", 1, 1, "no behaviour")),
    ] {
        let told = wrong(text);
        let [(code, line, col, message)] = &told[..] else {
            panic!("{text}: {told:?}");
        };
        let (expected_code, expected_line, expected_col, part) = expected;
        let place = (code.as_str(), *line, *col);
        assert_eq!(
            place,
            (expected_code, expected_line, expected_col),
            "{text}: {message}"
        );
        assert!(message.contains(part), "{text}: {message}");
    }
}

#[test]
fn a_script_goes_on_with_a_step_behind_a_label() {
    let script = script(
        "turn unless failed -> go_on home unless lasts after_s = 20 -> go_on last\n\
         go_to x_m = 1 unless stuck after_s = 1 -> insert turn\n\
         home: // where it began\n\
         go_to x_m = 0\n\
         last: turn unless failed -> cancel\n",
    );
    assert_eq!((script.steps, script.all.len()), (4, 5));
    let watch = |situation, value, reaction| Watch {
        situation,
        value,
        reaction,
    };
    let watches = |step: usize| script.all[step].watches().collect::<Vec<_>>();
    assert_eq!(
        watches(0),
        [
            watch(Situation::Failed, 0.0, Reaction::GoOn(2)),
            watch(Situation::Lasts, 20.0, Reaction::GoOn(3)),
        ]
    );
    assert_eq!(
        watches(1),
        [watch(Situation::Stuck, 1.0, Reaction::Insert(4))]
    );
    assert_eq!(
        watches(3),
        [watch(Situation::Failed, 0.0, Reaction::Cancel)]
    );
}

#[test]
fn what_takes_the_place_of_a_step_stands_behind_the_steps() {
    let script = script(
        "go_to x_m = 1 unless near range_m = 0.3 -> replace turn unless failed -> replace go_to x_m = 2\n\
         turn\n",
    );
    assert_eq!((script.steps, script.all.len()), (2, 4));
    let reactions: Vec<_> = (script.all[0].watches().map(|watch| watch.reaction)).collect();
    assert_eq!(reactions, [Reaction::Replace(2), Reaction::Replace(3)]);
    let names: Vec<_> = (script.all.iter()).map(|step| &*step.name).collect();
    assert_eq!(names, ["GoTo", "TurnTo", "TurnTo", "GoTo"]);
}

#[test]
fn each_line_with_a_mistake_is_told() {
    let told = wrong("go_too\nturn\nturn tim = 1\n");
    let lines: Vec<_> = told.iter().map(|(_, line, ..)| *line).collect();
    assert_eq!(lines, [1, 3]);
}

#[test]
fn a_script_may_have_as_many_steps_as_a_robot_has_room_for() {
    let most = "turn\n".repeat(MAX_SCRIPT_STEPS);
    assert_eq!(script(&most).all.len(), MAX_SCRIPT_STEPS);
    let more = most + "turn unless stuck after_s = 1 -> insert turn\n";
    let told = wrong(&more);
    assert!(told[0].3.contains("18 steps"), "{told:?}");
    let told = wrong(&("turn ".to_owned() + &"unless near range_m = 1 -> flag ".repeat(4)));
    assert!(told[0].3.contains("room for 3"), "{told:?}");
}

#[test]
fn a_name_is_of_what_is_sent() {
    let ids = [
        "turn",
        "turn times = 2",
        "turn\nturn",
        "turn unless near range_m = 1 -> flag",
    ]
    .map(|text| script(text).id());
    for (place, id) in ids.iter().enumerate() {
        assert!(!ids[..place].contains(id) && *id != 0);
    }
    assert_eq!(
        script("turn").id(),
        script("  turn_to  angle_rad=1.5 // so").id()
    );
}

#[test]
fn one_line_is_one_behaviour() {
    let tasks = tasks();
    let script = read_line(
        "argument",
        "go_to x_m = 1 unless near range_m = 1 -> cancel",
        &tasks,
    );
    assert_eq!(script.script.unwrap().all.len(), 1);
    for text in [
        "",
        "turn\nturn",
        "turn unless near range_m = 1 -> insert turn",
        "turn unless near range_m = 1 -> replace turn",
        "turn unless failed -> go_on a",
    ] {
        assert_eq!(read_line("argument", text, &tasks).script, None, "{text}");
    }
}
