//! Huge and hostile inputs, by name: what a generator writes, what a slip of a program leaves
//! behind, what somebody sends who means harm.
//!
//! Each grows with one number, so that its time can be held against its size.

use std::fmt::Write as _;

use crate::random::Random;

/// A kind of input.
#[derive(Clone, Copy, Debug)]
pub struct Shape {
    /// Its name.
    pub name: &'static str,
    /// Whether it is a mission without errors, as long as it is within the limits.
    pub is_right: bool,
    /// Makes it from its size: a count of things for a mission, bytes for garbage.
    pub make: fn(usize) -> Vec<u8>,
}

/// Missions in which one thing is there very often.
pub const MISSIONS: [Shape; 22] = [
    right("states of one region", |n| {
        let states = each(n, |i| format!("state S{i};\n"));
        let ring = each(n, |i| format!("S{i} -> S{};\n", (i + 1) % n));
        mission(
            "",
            &format!("region r {{ {states} initial -> S0;\n{ring} }}"),
        )
    }),
    right("containers of 100 states", |n| {
        let states = each(100, |i| {
            format!("state S{i}; S{i} -> S{};\n", (i + 1) % 100)
        });
        let containers = n.div_ceil(100);
        let parts = each(containers, |i| {
            format!("container C{i} {{ region r {{ initial -> S0; {states} }} }}\n")
        });
        let supers = each(containers, |i| {
            format!("super P{i}: C{i}; P{i} -> P{};\n", (i + 1) % containers)
        });
        mission(&parts, &format!("region r {{ initial -> P0; {supers} }}"))
    }),
    right("containers nested in each other", |n| {
        let parts = each(n, |i| {
            format!(
                "container C{} {{ region r {{ super S: C{i}; initial -> S; S -> S [exit]; }} }}\n",
                i + 1
            )
        });
        let inmost = "container C0 { region r { state S; initial -> S; S -> final; } }\n";
        mission(
            &format!("{inmost}{parts}"),
            &format!("region r {{ super S: C{n}; initial -> S; S -> S on *; }}"),
        )
    }),
    right("a container used twice by one used twice", |n| {
        // Twice as many instances a level, and as many levels as the size has bits.
        let levels = usize::BITS - n.leading_zeros();
        let parts = each(levels as usize, |i| {
            format!(
                "container C{} {{ region a {{ super S: C{i}; initial -> S; S -> S on *; }} region b {{ super S: C{i}; initial -> S; S -> S on *; }} }}\n",
                i + 1
            )
        });
        let inmost = "container C0 { region r { state S; initial -> S; S -> final; } }\n";
        mission(
            &format!("{inmost}{parts}"),
            &format!("region r {{ super S: C{levels}; initial -> S; S -> S on *; }}"),
        )
    }),
    right("transitions of one state", |n| {
        let ways = each(n, |i| format!("A -> B on E{};\n", i % 100));
        let events = each(100, |i| format!("event E{i};\n"));
        mission(
            "",
            &format!("{events} region r {{ state A; state B; initial -> A; {ways} B -> A; }}"),
        )
    }),
    right("guarded transitions of one state", |n| {
        let ways = each(n, |i| {
            format!("A -> A [.f{} and not .f{}];\n", i % 16, (i + 1) % 16)
        });
        let flags = each(16, |i| format!("out flag f{i}; "));
        mission(
            &format!("task T slot 2 {{ {flags} }}\n"),
            &format!("region r {{ task A: T; initial -> A; {ways} }}"),
        )
    }),
    right("task states in one slot", |n| {
        let states = each(n, |i| format!("task S{i}: T;\nS{i} -> S{};\n", (i + 1) % n));
        mission(
            "task T slot 2 wcet 1 us { }\n",
            &format!("region r {{ initial -> S0; {states} }}"),
        )
    }),
    right("regions with a task of one group each", |n| {
        let regions = each(n, |i| {
            format!("region r{i} {{ task S: T; initial -> S; S -> S on *; }}\n")
        });
        mission("task T slot 2 exclusive motors { }\n", &regions)
    }),
    right("paths of one net", |n| {
        let states = each(n, |i| format!("task R{i}: R;\nR{i} -> R{};\n", (i + 1) % n));
        let paths = each(n, |i| format!("path w.W.o -> r.R{i}.i;\n"));
        mission(
            "task W slot 2 { out data o: T; }\ntask R slot 2 { in data i: T; }\n",
            &format!(
                "region w {{ task W: W; initial -> W; W -> W on *; }} region r {{ initial -> R0; {states} }} {paths}"
            ),
        )
    }),
    right("writers of one net", |n| {
        let regions = each(n, |i| {
            format!("region w{i} {{ task W: W; initial -> W; W -> W on *; }}\n")
        });
        let paths = each(n, |i| format!("path w{i}.W.o -> r.R.i;\n"));
        mission(
            "task W slot 2 { out data o: T; }\ntask R slot 2 { in data i: T; }\n",
            &format!("region r {{ task R: R; initial -> R; R -> R on *; }} {regions} {paths}"),
        )
    }),
    right("ends of one path", |n| {
        let states = each(n, |i| format!("task R{i}: R;\nR{i} -> R{};\n", (i + 1) % n));
        let mut ends = each(n, |i| format!("r.R{i}.i,"));
        ends.pop();
        mission(
            "task W slot 2 { out data o: T; }\ntask R slot 2 { in data i: T; }\n",
            &format!(
                "region w {{ task W: W; initial -> W; W -> W on *; }} region r {{ initial -> R0; {states} }} path w.W.o -> {ends};"
            ),
        )
    }),
    right("events", |n| {
        let events = each(n, |i| format!("event E{i};\n"));
        let ways = each(n, |i| format!("S -> S on E{i} / send E{};\n", (i + 1) % n));
        mission(
            "",
            &format!("{events} region r {{ state S; initial -> S / send E0; {ways} }}"),
        )
    }),
    right("sends of one transition", |n| {
        let mut sends = each(n, |_| "send E,".to_owned());
        sends.pop();
        mission(
            "",
            &format!("event E; region r {{ state S; initial -> S / {sends}; S -> S on E; }}"),
        )
    }),
    right("terms of one guard", |n| {
        let mut terms = each(n, |i| {
            format!(".f{} {} ", i % 16, if i % 3 == 0 { "or" } else { "and" })
        });
        terms += "not exit";
        let flags = each(16, |i| format!("out flag f{i}; "));
        mission(
            &format!("task T slot 2 {{ {flags} }}\n"),
            &format!("region r {{ task A: T; initial -> A; A -> A [{terms}]; }}"),
        )
    }),
    right("slots and tasks", |n| {
        let slots = each(n, |i| {
            format!("slot {} period 4000 s duration 1 us;\n", i + 10)
        });
        let tasks = each(n, |i| {
            format!("task T{i} slot {} wcet 1 us {{ }}\n", i + 10)
        });
        let states = each(n, |i| {
            format!("task S{i}: T{i}; S{i} -> S{};\n", (i + 1) % n)
        });
        mission(
            &format!("{slots}{tasks}"),
            &format!("region r {{ initial -> S0; {states} }}"),
        )
    }),
    right("flags of one container", |n| {
        let flags = each(n, |i| format!("out flag f{i};\n"));
        let ways = each(n, |i| format!("S -> S / set ^f{i};\n"));
        mission(
            &format!("container C {{ {flags} region r {{ state S; initial -> S; {ways} }} }}\n"),
            "region r { super P: C; initial -> P; P -> P [.f0]; }",
        )
    }),
    wrong("unknown states, with as many known ones", |n| {
        let states = each(n, |i| format!("state State{i};\n"));
        let ways = each(n, |i| format!("State{i} -> Stave{i};\n"));
        mission(
            "",
            &format!("region r {{ {states} initial -> State0; {ways} }}"),
        )
    }),
    wrong("unknown events, tasks and flags", |n| {
        let events = each(n, |i| format!("event Event{i};\n"));
        let tasks = each(n, |i| format!("task Task{i} slot 2 {{ }}\n"));
        let states = each(n, |i| {
            format!("task S{i}: Tasks{i};\nS{i} -> S0 on Evnt{i} [.g{i}];\n")
        });
        mission(
            &tasks,
            &format!("{events} region r {{ initial -> S0; {states} }}"),
        )
    }),
    wrong("a long name that nothing is like", |n| {
        let states = each(1_000, |i| {
            format!("state {}{i};\n", "x".repeat(1 + n / 1_000))
        });
        let ways = each(1_000, |i| {
            format!("{}{i} -> y;\n", "z".repeat(1 + n / 1_000))
        });
        mission("", &format!("region r {{ {states} {ways} }}"))
    }),
    wrong("duplicate states", |n| {
        let states = each(n, |_| "state S;\n".to_owned());
        mission(
            "",
            &format!("region r {{ {states} initial -> S; S -> S; }}"),
        )
    }),
    wrong("duplicate regions and containers", |n| {
        let parts = each(n, |_| {
            "container C { region r { state S; initial -> S; S -> S; } }\n".to_owned()
        });
        let regions = each(n, |_| {
            "region r { super P: C; initial -> P; P -> P; }\n".to_owned()
        });
        mission(&parts, &regions)
    }),
    wrong(
        "a container that holds itself, with a long way round",
        |n| {
            let parts = each(n, |i| {
                format!(
                    "container C{i} {{ region r {{ super S: C{}; initial -> S; S -> S; }} }}\n",
                    (i + 1) % n
                )
            });
            mission(&parts, "region r { super S: C0; initial -> S; S -> S; }")
        },
    ),
];

/// Texts that are no mission at all.
pub const GARBAGE: [Shape; 21] = [
    wrong("random bytes", |n| {
        let mut random = Random::new(1);
        (0..n).map(|_| random.bits() as u8).collect()
    }),
    wrong("random printable characters", |n| {
        let mut random = Random::new(2);
        (0..n).map(|_| random.between(32, 126) as u8).collect()
    }),
    wrong("random words of the language", |n| {
        let words = crate::fuzzing::mutations::words();
        let mut random = Random::new(3);
        let mut text = String::new();
        while text.len() < n {
            text += random.pick(words).map_or("", String::as_str);
            text.push(if random.chance(10) { '\n' } else { ' ' });
        }
        text.into_bytes()
    }),
    wrong("nothing but {", |n| vec![b'{'; n]),
    wrong("nothing but }", |n| vec![b'}'; n]),
    wrong("nothing but (", |n| vec![b'('; n]),
    wrong("nothing but ;", |n| vec![b';'; n]),
    wrong("nothing but quotes", |n| vec![b'"'; n]),
    wrong("nothing but zeros", |n| vec![0; n]),
    wrong("a guard of (", |n| in_guard(&"(".repeat(n))),
    wrong("a guard of not", |n| in_guard(&"not ".repeat(n / 4))),
    wrong("a comment without end", |n| {
        format!("/*{}", " x".repeat(n / 2)).into_bytes()
    }),
    wrong("a string without end", |n| {
        format!("use \"{}", "x".repeat(n)).into_bytes()
    }),
    wrong("a string of all", |n| {
        format!("use \"{}\";", "x/".repeat(n / 2)).into_bytes()
    }),
    wrong("a number of all", |n| {
        format!("slot {}", "9".repeat(n)).into_bytes()
    }),
    wrong("a name of all", |n| {
        format!("task {} {{", "x".repeat(n)).into_bytes()
    }),
    wrong("a long name in many messages", |n| {
        // Half of the text is a name, the other half things that are wrong about it.
        let name = "x".repeat(n / 2);
        let ways = each(n / 80, |i| format!("S -> S [.flag{i}];\n"));
        mission(
            &format!("task {name} slot 2 {{ }}\n"),
            &format!("region r {{ task S: {name}; initial -> S; {ways} }}"),
        )
    }),
    wrong("one line", |n| {
        "task T { } state S -> ; ".repeat(n / 24).into_bytes()
    }),
    wrong("states with errors", |n| {
        each(n / 34, |i| {
            format!("state S{} timeout 5 sm\nS -> [exti;\n", i % 1_000)
        })
        .into_bytes()
    }),
    wrong("containers with errors", |n| {
        let parts = each(n / 100, |i| {
            format!(
                "container C{i} {{ region r {{ state A; state A; initial -> B; A -> C on E [.f] / set ^g; }} path a -> ; }}\n"
            )
        });
        mission(&parts, "region r { state S; initial -> S; }")
    }),
    wrong("uses of what is not there", |n| {
        each(n / 20, |i| format!("use \"no{i}.esm\";\n")).into_bytes()
    }),
];

const fn right(name: &'static str, make: fn(usize) -> Vec<u8>) -> Shape {
    Shape {
        name,
        is_right: true,
        make,
    }
}

const fn wrong(name: &'static str, make: fn(usize) -> Vec<u8>) -> Shape {
    Shape {
        name,
        is_right: false,
        make,
    }
}

/// The texts of `n` things, one after another.
fn each(n: usize, thing: impl Fn(usize) -> String) -> String {
    (0..n).map(thing).fold(String::new(), |mut all, thing| {
        all += &thing;
        all
    })
}

/// A mission of declarations and the content of its machine.
fn mission(declarations: &str, content: &str) -> Vec<u8> {
    let mut text = "interpreter slot 1;\nslot 1 period 4000 s duration 1 ms;\nslot 2 period 4000 s duration 1 s;\n".to_owned();
    let _ = writeln!(text, "{declarations}machine M {{\n{content}\n}}");
    text.into_bytes()
}

/// A mission with this guard.
fn in_guard(guard: &str) -> Vec<u8> {
    mission(
        "",
        &format!("region r {{ state S; initial -> S; S -> S [{guard}exit]; }}"),
    )
}
