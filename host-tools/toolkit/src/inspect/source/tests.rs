//! What comes back of what is easy to lose, and what is refused.

use std::time::Duration;

use esm_core::format::{CRC_BYTES, Envelope, MAGIC, NONE, crc32};

use super::*;

const LAY_OUT_LIMIT: Duration = Duration::from_secs(10);
const HEAD: &str = "interpreter slot 1; slot 1 period 10 ms duration 1 ms;\n";

fn blob(text: &str, names: NameTable) -> Vec<u8> {
    let mut checked = lang::load_text("test.esm", text);
    let schedule = checked.lay_out(LAY_OUT_LIMIT);
    assert!(!checked.has_errors(), "{}", checked.render(false));
    let model = checked.model.as_ref().unwrap();
    compile::compile_with(model, &schedule.unwrap(), names).unwrap()
}

fn source_of(blob: Vec<u8>) -> Result<String, NoSource> {
    source(&esm_core::verify(blob).unwrap(), LAY_OUT_LIMIT)
}

/// The source that comes back; that it makes the same blob was checked before it came.
#[track_caller]
fn back(text: &str) -> String {
    let text = format!("{HEAD}{text}");
    source_of(blob(&text, NameTable::LeftOut)).unwrap();
    source_of(blob(&text, NameTable::Kept)).unwrap()
}

#[test]
fn values_and_times_come_back_to_the_bit() {
    let lines = [
        "param a: f32 = 0.1;",
        "param b: f32 = -0.0;",
        "param c: f32 = 1e-45;",
        "param d: f32 = 3.4028235e38;",
        "param e: f32 = 16777216.0;",
        "param f: i32 = -2147483648;",
        "param g: u32 = 4294967295;",
        "param h: bool = true;",
        "param i: f32 = 5.0;",
        "in data fresh: X optional within 500 ms;",
        "inout data passed: X within 4000 s;",
        "in data any: X;",
        "out data made: X;",
    ];
    let source = back(&format!(
        "slot 4000000000 period 4000 s duration 0 us; task T slot 1 count 7 endless {{ {} }}\n\
         machine M {{ region r {{ task A: T timeout 4000 s; state B timeout 0 us; state C timeout 1500 ms; task D: T timeout 1 us with {{ f = 7 }}; initial -> A; }}\n\
         path A.made -> A.fresh, A.passed, A.any, D.fresh, D.passed, D.any; }}",
        lines.join(" ")
    ));
    for line in lines.into_iter().chain([
        "slot 4000000000 period 4000 s duration 0 us;",
        "task A: T timeout 4000 s;",
        "state B timeout 0 us;",
        "state C timeout 1500 ms;",
        "task D: T timeout 1 us with { f = 7 };",
    ]) {
        assert!(source.contains(line), "{line}\n{source}");
    }
}

#[test]
fn guards_come_back_as_they_are_written_simplest() {
    let cases = [
        ("exit", "on *"),
        ("not exit", "on pulse [not exit]"),
        ("not (exit or timeout)", "[not exit and not timeout]"),
        (
            "not (exit and not (timeout or busy))",
            "[not exit or timeout or busy]",
        ),
        (
            "(exit or timeout) and (busy or .f)",
            "[(exit or timeout) and (busy or .f)]",
        ),
        (
            "exit and timeout or busy and .f",
            "[exit and timeout or busy and .f]",
        ),
        (
            "exit and (timeout or (busy and (.f or exit)))",
            "[exit and (timeout or busy and (.f or exit))]",
        ),
        ("exit or exit", "[exit or exit]"),
    ];
    for (guard, expected) in cases {
        let source = back(&format!(
            "task T slot 1 {{ out flag f; }} machine M {{ region r {{ task A: T timeout 1 s; initial -> A; A -> final on pulse [{guard}]; }} }}"
        ));
        assert!(
            source.contains(&format!("{expected};")),
            "{guard}\n{source}"
        );
    }
}

#[test]
fn events_come_back_with_their_numbers_and_their_ways() {
    let source = back(
        "container Inner { in event Down; out event Up; event Own, Unused; region r { state A; initial -> A / send Up; A -> A on Down / send Own; A -> final on Own; } }\n\
         container Outer { in event Down; out event Up; in event Up; region r { super I: Inner; super J: Inner; initial -> I; I -> J on Up; } region q { state A; initial -> A; } }\n\
         machine M { event Never, Down, Up; region r { super O: Outer; initial -> O / send Down; O -> O on Up / send Down; } }",
    );
    for line in [
        "event Never, Down, Up;",
        "in event Down;",
        "out event Up;",
        "event Own, Unused;",
    ] {
        assert!(source.contains(line), "{line}\n{source}");
    }
}

#[test]
fn the_order_in_which_events_are_sent_comes_back() {
    let source = back(
        "machine M { event A, B, C; region r { state S; state T; initial -> S; T -> S / send C; S -> T on A / send B, send C; S -> T / send A; } }",
    );
    let place = |line: &str| {
        source
            .find(line)
            .unwrap_or_else(|| panic!("{line}\n{source}"))
    };
    assert!(place("/ send C") < place("/ send B, send C"));
}

#[test]
fn nets_without_an_end_come_back() {
    let tasks = "task W slot 1 { out data w: T; } task R slot 1 { in data r: T; } task B slot 1 { inout data b: T; }\n";
    let missions = [
        // A writer that nobody reads.
        "container C { in data p: T optional; region r { state A; initial -> A; } }\n\
         machine M { region r { task A: W; super S: C; initial -> A; } path A.w -> S.p; }",
        // A reader whose net leads through a container to nowhere.
        "container C { in data p: T optional; out data q: T; region r { state A; initial -> A; } path p -> q; }\n\
         machine M { region r { task A: R; task A2: R; super S: C; initial -> A; } path S.q -> A.r, A2.r; }",
        // A reader in a container that is left open.
        "container C { in data p: T optional; region r { task A: R; initial -> A; } path p -> A.r; }\n\
         machine M { region r { super S: C; initial -> S; } }",
        // One port, both ways.
        "machine M { region r { task A: B; initial -> A; } path A.b -> A.b; }",
        // On no net, and on one with nobody else.
        "container C { out data p: T; region r { task A: W; task B: W; initial -> A; } path A.w -> p; }\n\
         machine M { region r { super S: C; initial -> S; } }",
        // Joined outside, and only there.
        "container C { in data i: T; out data o: T; region r { task A: W; task Z: R; initial -> A; } path A.w -> o; path i -> Z.r; }\n\
         machine M { region r { super S: C; super U: C; initial -> S; } path S.o -> U.i; path U.o -> S.i; }",
        // Two states of one name.
        "machine M { region r { task A: W; initial -> A; } region q { task A: R; initial -> A; } path r.A.w -> q.A.r; }",
    ];
    for mission in missions {
        back(&format!("{tasks}{mission}"));
    }
}

#[test]
fn a_source_says_what_it_is() {
    let text = format!("{HEAD}machine M {{ region r {{ state A; initial -> A; }} }}");
    let named = blob(&text, NameTable::Kept);
    let start = format!(
        "// Mission M, read back from the blob {:08x} of {} bytes",
        crc_of(&named),
        named.len()
    );
    assert!(source_of(named).unwrap().starts_with(&start));
    let nameless = source_of(blob(&text, NameTable::LeftOut)).unwrap();
    assert!(
        nameless.contains("// Its names were left out"),
        "{nameless}"
    );
    assert!(nameless.contains("machine Machine1 {"), "{nameless}");
}

fn crc_of(blob: &[u8]) -> u32 {
    let (_, crc) = blob.split_last_chunk::<CRC_BYTES>().unwrap();
    u32::from_le_bytes(*crc)
}

/// The blob with some bytes of one section changed.
macro_rules! with_section {
    ($blob:expr, $section:ident, $change:expr) => {{
        let blob: &[u8] = $blob;
        let body = &blob[MAGIC.len()..blob.len() - CRC_BYTES];
        let envelope: Envelope<'_> = postcard::from_bytes(body).unwrap();
        let mut bytes = envelope.$section.to_vec();
        let change: fn(&mut Vec<u8>) = $change;
        change(&mut bytes);
        let $section = &bytes[..];
        let changed = Envelope {
            $section,
            ..envelope
        };
        let mut blob = postcard::to_extend(&changed, MAGIC.to_vec()).unwrap();
        blob.extend_from_slice(&crc32(&blob).to_le_bytes());
        blob
    }};
}

#[test]
fn blobs_of_no_source_are_refused_with_the_reason() {
    let text = format!(
        "{HEAD}task T slot 1 exclusive g {{ out flag a; out flag b; param x: f32 = 1.5; param y: bool = true; inout data d: D; }}\n\
         container C {{ in event Go; out flag done; out data d: D; region r {{ task A: T; initial -> A / set ^done; A -> A on Go; }} path A.d -> d; }}\n\
         machine M {{ event Go; region r {{ super S: C; super U: C; task A: T; initial -> S; S -> U on pulse [.done] / send Go;\n\
         A -> A on pulse [.a or .b or exit or busy]; }} path S.d, U.d -> A.d; }}"
    );
    let good = blob(&text, NameTable::Kept);
    assert!(source_of(good.clone()).is_ok());
    let cases = [
        (
            // The first name is that of the event `Go`.
            with_section!(&good, names, |names| names[1..3].copy_from_slice(b"in")),
            "it calls something `in`, which is no name in the language",
        ),
        (
            with_section!(&good, params, |params| params[..4]
                .copy_from_slice(&f32::NAN.to_le_bytes())),
            "parameter `x` of",
        ),
        (
            with_section!(&good, params, |params| params[4] = 2),
            "parameter `y` of",
        ),
        (
            // The second use of the container has its port open.
            with_section!(&good, connections, |nets| nets[2..4]
                .copy_from_slice(&NONE.to_le_bytes())),
            "port `A.d` is on a net in one instance of its container and open in another",
        ),
        (
            // The first use of the container does not hear the event that the second hears.
            with_section!(&good, listeners, |row| row[3] &= !(1 << 6)),
            "its source would compile to another blob, which differs from byte",
        ),
        (
            // Behind the guard of four tests and its end stands the action in the container. Its
            // first test jumps to its last.
            with_section!(&good, code, |code| {
                let at = code.len() - 4 * 6;
                code[at + 2] = 3;
                code[at + 6] = 0;
            }),
            "the guard of `A -> A` in `M` jumps as no expression does",
        ),
        (
            // The first guard reads the exit flag of the machine.
            with_section!(&good, code, |code| {
                let test = code
                    .chunks_exact_mut(4)
                    .find(|record| record[3] >> 5 == 1)
                    .unwrap();
                test[..2].copy_from_slice(&[0, 0]);
            }),
            "`A -> A` in `M` uses flag bit 0, which has no name there",
        ),
        (
            // Two tasks of one group are in none.
            with_section!(&good, tasks, |tasks| tasks[12..14]
                .copy_from_slice(&NONE.to_le_bytes())),
            "its source would compile to another blob, which differs from byte",
        ),
    ];
    for (blob, reason) in cases {
        let verified = esm_core::verify(blob).unwrap();
        match source(&verified, LAY_OUT_LIMIT) {
            Ok(source) => panic!("{reason}\n{source}"),
            Err(cause) => assert!(cause.to_string().starts_with(reason), "{reason}: {cause}"),
        }
    }
}

/// A source that would be refused is never given out, whatever made the blob so.
#[test]
fn a_machine_in_which_a_region_never_starts_is_refused() {
    let text = format!("{HEAD}machine M {{ region r {{ state A; initial -> A; }} }}");
    let good = blob(&text, NameTable::LeftOut);
    let states = with_section!(&good, states, |states| {
        // The only transition leaves `A`.
        // For it both the events and where those on the pulse end, or begin, are others.
        for field in [0, 6, 16, 20] {
            states[field] ^= 1;
        }
    });
    let refused = source_of(states);
    let said = refused.unwrap_err().to_string();
    assert!(
        said.starts_with("its source would be refused: region"),
        "{said}"
    );
}

#[test]
fn links_and_frames_come_back() {
    let text = "
slot 2 period 10 ms duration 1 ms;
slot 3 period 20 ms duration 1 ms;
link spare rate 9600 bps;
frame nobody 1 out on spare: Pose payload 12 bytes period 1 s;
link radio rate 115200 bps header 6 bytes gap 50 us bits 9;
link wire rate 9600 bps;
frame pose 7 out on radio: Pose payload 12 bytes period 100 ms;
frame range 7 in on radio: Range payload 8 bytes period 100 ms late 150 ms;
frame alarm 8 out on radio flags lost, low payload 1 bytes rate 20 Hz;
frame orders 2047 in on radio flags stop, go payload 240 bytes period 50 ms;
frame told 1 in on wire: Range payload 8 bytes period 1 s;
frame lost 1 out on wire: Range payload 8 bytes period 1 s;
task Where slot 2 { out data pose: Pose; }
task Watch slot 2 { in data range: Range optional; }
machine M {
  region r { task P: Where; task Q: Watch; initial -> P; P -> Q; Q -> P; }
  region s { task S: radio.transmit slot 3; initial -> S / set .lost; }
  region t { task R: radio.receive slot 3; state End; initial -> R; R -> End [.stop]; }
  region w { task W: wire.receive slot 2; initial -> W; W -> W [.errors]; }
  path P.pose -> S.pose;
  path R.range, W.told -> Q.range;
}
";
    let source = back(text);
    let links = source
        .lines()
        .filter(|line| line.starts_with("link") || line.starts_with("frame"));
    let expected = "\
link radio rate 115200 bps header 6 bytes gap 50 us bits 9;
frame pose 7 out on radio: Pose payload 12 bytes period 100 ms;
frame alarm 8 out on radio flags lost, low payload 1 bytes period 50 ms;
frame range 7 in on radio: Range payload 8 bytes period 100 ms late 150 ms;
frame orders 2047 in on radio flags stop, go payload 240 bytes period 50 ms;
link wire rate 9600 bps;
frame told 1 in on wire: Range payload 8 bytes period 1 s;";
    assert_eq!(links.collect::<Vec<_>>().join("\n"), expected, "{source}");
}
