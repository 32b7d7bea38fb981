//! Missions made for one construct each, in several sizes, and the costs of constructs that follow
//! from what they take.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use host_tools::bound::costs::{Construct, Costs, Counts};

/// A mission that is all one construct.
pub struct Example {
    /// What there is much of.
    pub name: String,
    /// Its text.
    pub text: String,
}

const HEADER: &str = "interpreter slot 1; queue 255;\nslot 1 period 10 ms duration 5 ms;\nslot 2 period 10 ms duration 1 ms;\n\
     task Do slot 2 { out flag a; out flag b; out flag c; out flag d; in flag e; in flag f; in flag g; }\n\
     task Wide slot 2 { out flag a0; WIDE }\n\
     task Below slot 0 { out flag a; }\n";

/// The sizes of each.
const SIZES: [usize; 5] = [1, 2, 3, 5, 9];

/// All missions.
pub fn examples() -> Vec<Example> {
    let mut examples = Vec::new();
    for (name, make) in MAKERS {
        for size in SIZES {
            let wide: String = (1..size * 12)
                .map(|it| format!("out flag a{it}; "))
                .collect();
            let (before, machine) = make(size);
            let header = HEADER.replace("WIDE", &wide);
            examples.push(Example {
                name: format!("{name} {size}"),
                text: format!(
                    "{header}{before}machine M {{ event E, F, G, H;\nregion drive {{ task Go: Do; initial -> Go; Go -> Go [.a]; Go -> Go [.b] / send E; \
                     Go -> Go [.c] / send E, send F; }}\n{machine}}}\n"
                ),
            });
        }
    }
    examples
}

/// What stands before the machine, and what is in it beside the region `drive`.
type Maker = fn(usize) -> (String, String);

const MAKERS: [(&str, Maker); 30] = [
    ("idle regions", |size| {
        repeated(size, |it| {
            format!("region r{it} {{ state S; initial -> S; S -> S on H; }}")
        })
    }),
    ("regions with a failing guard", |size| {
        repeated(size, |it| {
            format!(
                "region r{it} {{ task S: Do; initial -> S; S -> S [.a and not .a]; S -> S on *; }}"
            )
        })
    }),
    ("failing guards in one state", |size| {
        let tests = lines(size, |it| {
            format!("S -> S [.{} and .d]; ", ["a", "b", "c"][it % 3])
        });
        (
            String::new(),
            format!("region r {{ task S: Do; initial -> S; {tests} }}"),
        )
    }),
    (
        "guards that stand in a row, and the other way round",
        |size| {
            let flags = |it: usize| format!("S -> S [.a{it}] / send F; ");
            let (row, reversed) = (lines(size, flags), lines(size, |it| flags(size - 1 - it)));
            (
                String::new(),
                format!(
                    "region r {{ task S: Wide; initial -> S; {row} }} region q {{ task S: Wide; initial -> S; {reversed} }}"
                ),
            )
        },
    ),
    ("terms of a conjunction", |size| {
        let terms = vec![".a and not .b"; size].join(" and .c and ");
        (
            String::new(),
            format!("region r {{ task S: Do; initial -> S; S -> S [{terms}]; }}"),
        )
    }),
    ("terms of a disjunction", |size| {
        let terms = (0..size)
            .map(|it| [".a and .b", "not .c and .d", "exit and .c"][it % 3])
            .collect::<Vec<_>>()
            .join(" or ");
        (
            String::new(),
            format!("region r {{ task S: Do; initial -> S; S -> S [{terms}]; }}"),
        )
    }),
    ("flags of the superstate around", |size| {
        let terms = vec!["^o and not ^p"; size].join(" or ");
        let inside = format!(
            "container C {{ out flag o; out flag p; region r {{ task S: Do; initial -> S; S -> S [.a] / set ^o; S -> S [.b] / clear ^o, set ^p; S -> S [{terms}]; }} }}\n"
        );
        (
            inside,
            "region r { super C1: C; initial -> C1; C1 -> C1 [.o and .p]; }".to_owned(),
        )
    }),
    ("receivers", |size| {
        repeated(size, |it| {
            format!("region r{it} {{ state S; state R; initial -> S; S -> R on E; R -> S on E; }}")
        })
    }),
    ("receivers that wait for another event", |size| {
        repeated(size, |it| {
            format!("region r{it} {{ state S; initial -> S; S -> S on F; S -> S on H; }}")
        })
    }),
    ("events of a state", |size| {
        let others = lines(size, |it| {
            format!("S -> R on {}; ", ["F", "G", "H"][it % 3])
        });
        (
            String::new(),
            format!(
                "region r {{ task S: Do; state R; initial -> S; {others} S -> R on E [.a]; S -> R on E [.b and .c]; S -> S on E; R -> S; }}"
            ),
        )
    }),
    ("events one after another", |size| {
        let names: Vec<String> = (0..=size).map(|it| format!("X{it}")).collect();
        let mut text = format!("event {};\n", names.join(", "));
        text += "region first { state S; initial -> S; S -> S on E / send X0; }\n";
        for (it, pair) in names.windows(2).enumerate() {
            let _ = writeln!(
                text,
                "region r{it} {{ state S; initial -> S; S -> S on {} / send {}; }}",
                pair[0], pair[1]
            );
        }
        (String::new(), text)
    }),
    ("events at once", |size| {
        let sends = vec!["send F"; size].join(", ");
        (
            String::new(),
            format!(
                "region r {{ task S: Do; initial -> S; S -> S [.a] / {sends}; }} region q {{ state S; initial -> S; S -> S on F; }}"
            ),
        )
    }),
    ("flags that are written", |size| {
        let writes = (0..size)
            .map(|it| ["set .e", "clear .f", "set .g"][it % 3])
            .collect::<Vec<_>>()
            .join(", ");
        (
            String::new(),
            format!("region r {{ task S: Do; initial -> S; S -> S [.a or exit] / {writes}; }}"),
        )
    }),
    ("tasks that are entered and left", |size| {
        repeated(size, |it| {
            format!("region r{it} {{ task S: Do; task R: Below; initial -> S; S -> R; R -> S; }}")
        })
    }),
    ("flags of a task", |size| {
        let _ = size;
        (String::new(), "region r { task S: Wide; state R; initial -> S; S -> R [.a0]; R -> S; } region q { task S: Wide; initial -> S; S -> S; }".to_owned())
    }),
    ("timers", |size| {
        repeated(size, |it| {
            format!(
                "region r{it} {{ state S timeout {} ms; task R: Do timeout 5 ms; initial -> S; S -> R [timeout]; R -> S [timeout and .a]; }}",
                10 * it + 15
            )
        })
    }),
    ("regions of a superstate", |size| {
        let inside = lines(size, |it| {
            format!("region i{it} {{ state S; initial -> S; S -> S on E; }}\n")
        });
        (
            format!("container C {{ in event E; {inside} }}\n"),
            "region r { super C1: C; task S: Do; initial -> C1; C1 -> S on F; S -> C1; } region q { super C2: C; initial -> C2; C2 -> C2 on F; }".to_owned(),
        )
    }),
    ("tasks of a superstate", |size| {
        let inside = lines(size, |it| {
            format!(
                "region i{it} {{ task S: Do; task R: Do; initial -> S; S -> R on *; R -> final [.a]; }}\n"
            )
        });
        (
            format!("container C {{ {inside} }}\n"),
            "region r { super C1: C; initial -> C1; C1 -> C1 [exit or not busy]; } region q { super C2: C; initial -> C2; C2 -> C2 on F; }".to_owned(),
        )
    }),
    ("superstates in superstates", |size| {
        let mut text = "container C0 { in event E; region i { task S: Do; initial -> S; S -> final [.a]; S -> S on E; } }\n".to_owned();
        for it in 1..=size {
            let _ = writeln!(
                text,
                "container C{it} {{ in event E; region i {{ super S: C{}; initial -> S; S -> S on *; S -> final [busy and exit]; }} }}",
                it - 1
            );
        }
        (
            text,
            format!("region r {{ super S: C{size}; initial -> S; S -> S on F; S -> S [exit]; }}"),
        )
    }),
    ("words of regions", |size| containers(2 * size, "")),
    ("words of regions that listen", |size| {
        containers(size, "S -> S on E;")
    }),
    ("words behind a superstate that is entered", |size| {
        let (before, regions) = containers(2 * size, "");
        behind(&before, &regions)
    }),
    ("words of those that would listen behind it", |size| {
        let (before, _) = containers(0, "S -> S on E;");
        let regions = lines(2 * size, |it| {
            format!("region r{it} {{ super S: C; state R; initial -> R; R -> S on H; }}\n")
        });
        behind(&before, &regions)
    }),
    ("words of regions without timers that run", |size| {
        let others = lines(REGIONS * size, |it| {
            format!("region r{it} {{ state S; initial -> S; S -> S on H; }}\n")
        });
        (
            String::new(),
            format!(
                "{others}region timed {{ state S timeout 15 ms; state R; initial -> S; S -> R [timeout]; R -> S on E; }}"
            ),
        )
    }),
    ("words of regions of a superstate", |size| {
        let inside = lines(REGIONS * size, |it| {
            format!("region i{it} {{ state S; initial -> S; S -> S on H; }}\n")
        });
        (
            format!(
                "container C {{ in event E; in event H; region first {{ state S; initial -> S; S -> final on E; }} {inside} }}\n"
            ),
            "region r { super S: C; state R; initial -> S; S -> S on F; S -> R [exit]; R -> S; }"
                .to_owned(),
        )
    }),
    ("words of regions that a flag wakes", |size| {
        let inside = lines(REGIONS * size, |it| {
            format!("region i{it} {{ state S; initial -> S; S -> S on H; }}\n")
        });
        (
            format!("container C {{ out flag o; in event H; region first {{ task S: Do; initial -> S; S -> S [.a] / set ^o; S -> S [.b] / clear ^o; }} {inside} }}\n"),
            "region r { super S: C timeout 25 ms; initial -> S; S -> S on F; S -> S [timeout and .o]; }".to_owned(),
        )
    }),
    ("words of regions that may be busy", |size| {
        let inside = lines(REGIONS * size, |it| {
            format!("region i{it} {{ state S; initial -> S; S -> S on H; }}\n")
        });
        (
            format!(
                "container C {{ in event H; region first {{ task S: Do; initial -> S; S -> S on *; }} {inside} }}\n"
            ),
            "region r { super S: C; initial -> S; S -> S [busy]; S -> S on F [not busy]; }"
                .to_owned(),
        )
    }),
    ("regions that are awake in vain", |size| {
        let inside = lines(REGIONS * size, |it| {
            format!("region i{it} {{ state S; initial -> S; S -> S on H; }}\n")
        });
        (
            format!("container C {{ in event H; {inside} }}\n"),
            "region r { super S: C; state R; initial -> R; R -> S on E; S -> R on F; }".to_owned(),
        )
    }),
    ("timers in superstates", |size| {
        let inside = lines(size, |it| {
            format!(
                "region i{it} {{ state S timeout {} ms; task R: Do timeout 15 ms; initial -> S; S -> R [timeout]; R -> S [timeout]; }}\n",
                5 + 10 * it
            )
        });
        (
            format!("container C {{ {inside} }}\n"),
            "region r { super S: C timeout 35 ms; super T: C; initial -> S; S -> T [timeout]; T -> S on F; }".to_owned(),
        )
    }),
    ("events in a circle", |size| {
        let receivers = lines(size, |it| {
            format!("region r{it} {{ state S; initial -> S; S -> S on F; }}\n")
        });
        (
            String::new(),
            format!("region r {{ state S; initial -> S; S -> S on F / send F; }}\n{receivers}"),
        )
    }),
];

/// More regions than a word of the interpreter has bits.
const REGIONS: usize = 40;

/// Regions behind one that enters a superstate again and again.
fn behind(before: &str, regions: &str) -> (String, String) {
    let inside = "container D { region x { task S: Do; initial -> S; S -> final [.a]; } }\n";
    let first = "region first { super T: D; initial -> T; T -> T [exit]; T -> T on E; }\n";
    (format!("{before}{inside}"), format!("{first}{regions}"))
}

/// So many superstates with [`REGIONS`] each, whose states have a transition more.
fn containers(size: usize, transition: &str) -> (String, String) {
    let inside = lines(REGIONS, |it| {
        format!("region i{it} {{ state S; initial -> S; S -> S on H; {transition} }}\n")
    });
    let superstates = lines(size, |it| {
        format!("region r{it} {{ super S: C; initial -> S; S -> S on H; }}\n")
    });
    (
        format!("container C {{ in event E; in event H; {inside} }}\n"),
        superstates,
    )
}

fn repeated(size: usize, line: impl Fn(usize) -> String) -> (String, String) {
    (String::new(), lines(size, |it| line(it) + "\n"))
}

fn lines(size: usize, line: impl Fn(usize) -> String) -> String {
    (0..size).map(line).collect()
}

/// A macro step: what it consisted of, and what it took.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Its constructs.
    pub counts: Counts,
    /// Instructions.
    pub instructions: u64,
}

/// What is added to what was measured, in percent: for ways through the interpreter that no sample
/// went.
pub const MARGIN_PERCENT: u64 = 5;

/// Finds the cost of each construct, so that no sample takes more than its constructs cost, and all
/// of them together cost as little more than they take as can be.
///
/// That is a linear program with as many unknowns as constructs and as many conditions as samples,
/// each of which counts by how much more it costs than it takes, relatively. It is solved by its
/// dual, which begins with a solution, and in whose last row the answer stands at the end. At last
/// [`MARGIN_PERCENT`] are added, and all is rounded up.
pub fn fit(samples: &[Sample]) -> Costs {
    const EPSILON: f64 = 1e-9;
    let samples = without_repetitions(samples);
    let rows = Construct::ALL.len();
    let columns = samples.len() + rows;
    let mut table = vec![vec![0.0; columns + 1]; rows + 1];
    for (row, construct) in Construct::ALL.into_iter().enumerate() {
        for (column, sample) in samples.iter().enumerate() {
            let count = sample.counts.of(construct) as f64;
            table[row][column] = count;
            table[row][columns] += count / sample.instructions.max(1) as f64;
        }
        table[row][samples.len() + row] = 1.0;
        // What no sample has is free of cost for all that they say.
        table[row][columns] += EPSILON;
    }
    for (column, sample) in samples.iter().enumerate() {
        table[rows][column] = -(sample.instructions as f64);
    }
    let mut basis: Vec<usize> = (samples.len()..columns).collect();
    loop {
        let entering = (0..columns)
            .filter(|&column| table[rows][column] < -EPSILON)
            .min_by(|&a, &b| table[rows][a].total_cmp(&table[rows][b]));
        let Some(entering) = entering else { break };
        let leaving = (0..rows)
            .filter(|&row| table[row][entering] > EPSILON)
            .min_by(|&a, &b| {
                let ratio = |row: usize| table[row][columns] / table[row][entering];
                ratio(a).total_cmp(&ratio(b)).then(basis[a].cmp(&basis[b]))
            });
        let Some(leaving) = leaving else { break };
        let pivot = table[leaving][entering];
        for value in &mut table[leaving] {
            *value /= pivot;
        }
        let pivot_row = table[leaving].clone();
        for (row, values) in table.iter_mut().enumerate() {
            let factor = values[entering];
            if row != leaving && factor != 0.0 {
                for (value, pivot) in values.iter_mut().zip(&pivot_row) {
                    *value -= factor * pivot;
                }
            }
        }
        basis[leaving] = entering;
    }
    let mut costs = Costs::default();
    for (row, construct) in Construct::ALL.into_iter().enumerate() {
        let cost = table[rows][samples.len() + row] * (100 + MARGIN_PERCENT) as f64 / 100.0;
        let whole = cost as u32;
        // Beyond what arithmetic is not exact by.
        let has_rest = cost > f64::from(whole) + 1e-4;
        costs.set(construct, whole + u32::from(has_rest));
    }
    costs
}

/// Of samples that consist of the same, only the longest.
fn without_repetitions(samples: &[Sample]) -> Vec<Sample> {
    let mut longest: BTreeMap<Vec<u64>, Sample> = BTreeMap::new();
    for sample in samples {
        let counts = Construct::ALL.into_iter().map(|it| sample.counts.of(it));
        let known = longest.entry(counts.collect()).or_insert(*sample);
        if known.instructions < sample.instructions {
            *known = *sample;
        }
    }
    longest.into_values().collect()
}

#[cfg(test)]
mod tests {
    use host_tools::bound::costs::Ledger;

    use super::*;

    #[test]
    fn costs_that_explain_all_samples_are_found() {
        let mut known = Costs::default();
        let constructs = [Construct::Step, Construct::Taken, Construct::Send];
        for (construct, cost) in constructs.into_iter().zip([100, 30, 7]) {
            known.set(construct, cost);
        }
        let mut samples = Vec::new();
        for (taken, sent) in [(0, 0), (1, 0), (3, 1), (2, 5)] {
            let mut counts = Counts::default();
            counts.add(Construct::Step, 1);
            counts.add(Construct::Taken, taken);
            counts.add(Construct::Send, sent);
            samples.push(Sample {
                counts,
                instructions: known.total(&counts),
            });
        }
        let near = |costs: &Costs| {
            let exact = constructs.map(|it| known.of(it));
            let found = constructs.map(|it| costs.of(it));
            exact
                .into_iter()
                .zip(found)
                .all(|(exact, found)| (exact..=exact + exact / 25 + 1).contains(&found))
        };
        let fitted = fit(&samples);
        assert!(near(&fitted), "{fitted}");
        // One that takes more is covered.
        let more = Sample {
            instructions: samples[3].instructions + 90,
            ..samples[3]
        };
        samples.push(more);
        let fitted = fit(&samples);
        assert!(
            samples
                .iter()
                .all(|sample| fitted.total(&sample.counts) >= sample.instructions),
            "{fitted}"
        );
    }

    #[test]
    fn every_example_is_a_mission() {
        for example in examples() {
            if let Err(error) = crate::subject::build(&example.text) {
                panic!("{}: {error}\n{}", example.name, example.text);
            }
        }
    }
}
