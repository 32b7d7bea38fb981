//! Random missions that are all data paths, as `.esm` text: containers with ports of every kind,
//! used several times side by side and inside each other, and paths that join, pass through,
//! dangle, or lead nowhere.
//!
//! Not all of them are free of errors: whether a net has a writer depends on what is inside of
//! containers. Who wants one without takes the next seed.

use std::fmt::Write as _;

use crate::random::Random;

const TYPES: [&str; 2] = ["Scan", "Twist"];
const DIRECTIONS: [&str; 3] = ["in", "out", "inout"];

#[derive(Clone)]
struct Port {
    name: String,
    type_name: &'static str,
    direction: &'static str,
    is_optional: bool,
    within_ms: Option<usize>,
}

impl Port {
    fn must_be_joined(&self) -> bool {
        self.direction == "in" && (!self.is_optional || self.within_ms.is_some())
    }
}

/// Something with ports: a task or a container.
struct Kind {
    name: String,
    ports: Vec<Port>,
}

/// The text of the mission that belongs to `seed`.
pub fn mission(seed: u64) -> String {
    let mut random = Random::new(seed);
    let mut text = "interpreter slot 1;\nslot 1 period 10 ms duration 1 ms;\n".to_owned();
    let mut tasks = Vec::new();
    for index in 0..random.between(1, 4) {
        let name = format!("Task{index}");
        let count = random.between(1, 3);
        let mut ports = ports(&mut random, count);
        for port in ports.iter_mut().filter(|port| port.direction != "out") {
            if random.chance(30) {
                port.within_ms = Some(random.between(1, 30));
            }
        }
        let endless = if random.chance(30) { " endless" } else { "" };
        line(
            &mut text,
            format_args!("task {name} slot 1{endless} {{ {} }}", declared(&ports)),
        );
        tasks.push(Kind { name, ports });
    }
    let mut containers: Vec<Kind> = Vec::new();
    for index in 0..random.below(5) {
        let name = format!("Part{index}");
        let count = random.below(5);
        let ports = ports(&mut random, count);
        line(
            &mut text,
            format_args!("container {name} {{ {}", declared(&ports)),
        );
        body(&mut random, &mut text, &tasks, &containers, &ports);
        containers.push(Kind { name, ports });
    }
    line(&mut text, format_args!("machine Nets {{"));
    body(&mut random, &mut text, &tasks, &containers, &[]);
    text
}

fn line(text: &mut String, line: std::fmt::Arguments<'_>) {
    writeln!(text, "{line}").expect("a string takes all that is written");
}

fn ports(random: &mut Random, count: usize) -> Vec<Port> {
    (0..count)
        .map(|index| {
            let direction = DIRECTIONS[random.below(DIRECTIONS.len())];
            Port {
                name: format!("p{index}"),
                type_name: TYPES[random.below(TYPES.len())],
                direction,
                is_optional: direction == "in" && random.chance(60),
                within_ms: None,
            }
        })
        .collect()
}

fn declared(ports: &[Port]) -> String {
    let port = |port: &Port| {
        let optional = if port.is_optional { " optional" } else { "" };
        let within = match port.within_ms {
            Some(within_ms) => format!(" within {within_ms} ms"),
            None => String::new(),
        };
        format!(
            "{} data {}: {}{optional}{within};",
            port.direction, port.name, port.type_name
        )
    };
    ports.iter().map(port).collect::<Vec<_>>().join(" ")
}

/// An end of a path: how it is written, and on which sides of the arrow it can stand.
struct End {
    text: String,
    type_name: &'static str,
    is_source: bool,
    is_target: bool,
    must_be_joined: bool,
}

/// Writes two regions, in which states have the same names, and the paths, to the closing brace.
fn body(random: &mut Random, text: &mut String, tasks: &[Kind], containers: &[Kind], own: &[Port]) {
    let mut ends: Vec<End> = own
        .iter()
        .map(|port| End {
            text: port.name.clone(),
            type_name: port.type_name,
            is_source: port.direction != "out",
            is_target: port.direction != "in",
            must_be_joined: false,
        })
        .collect();
    for region in 0..random.between(1, 2) {
        line(text, format_args!("  region r{region} {{"));
        for state in 0..random.between(1, 3) {
            let container = random
                .pick(containers)
                .filter(|_| random.clone().chance(60));
            let (word, kind) = match container {
                Some(container) => ("super", container),
                None => ("task", &tasks[random.below(tasks.len())]),
            };
            line(text, format_args!("    {word} s{state}: {};", kind.name));
            line(text, format_args!("    initial -> s{state};"));
            ends.extend(kind.ports.iter().map(|port| End {
                text: format!("r{region}.s{state}.{}", port.name),
                type_name: port.type_name,
                is_source: port.direction != "in",
                is_target: port.direction != "out",
                must_be_joined: port.must_be_joined(),
            }));
        }
        line(text, format_args!("  }}"));
    }
    for type_name in TYPES {
        let of_type = || ends.iter().filter(|end| end.type_name == type_name);
        let sources: Vec<_> = of_type().filter(|end| end.is_source).collect();
        let targets: Vec<_> = of_type().filter(|end| end.is_target).collect();
        let some = |random: &mut Random, ends: &[&End]| {
            let count = random.between(1, 2);
            let texts = (0..count).filter_map(|_| random.pick(ends).map(|end| end.text.clone()));
            texts.collect::<Vec<_>>().join(", ")
        };
        for _ in 0..random.below(4) {
            let (from, to) = (some(random, &sources), some(random, &targets));
            if !from.is_empty() && !to.is_empty() {
                line(text, format_args!("  path {from} -> {to};"));
            }
        }
        for end in targets.iter().filter(|end| end.must_be_joined) {
            let from = some(random, &sources);
            if !from.is_empty() {
                line(text, format_args!("  path {from} -> {};", end.text));
            }
        }
    }
    line(text, format_args!("}}"));
}
