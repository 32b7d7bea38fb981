use std::time::Duration;

use proptest::prelude::*;

use super::*;
use crate::work_time;

fn slot(number: u32, period_us: u32, duration_us: u32) -> SlotSpec {
    SlotSpec {
        number,
        period_us,
        duration_us,
        fixed_start_us: None,
    }
}

/// Slots of (period, duration), numbered from 1.
pub(super) fn slots(times_us: &[(u32, u32)]) -> Vec<SlotSpec> {
    times_us
        .iter()
        .zip(1..)
        .map(|(&(period_us, duration_us), number)| slot(number, period_us, duration_us))
        .collect()
}

/// (period, duration) of slots, in microseconds.
type Times = &'static [(u32, u32)];

/// Slots, their starts, and what the checker says.
type CheckCase<'c> = (&'c [SlotSpec], &'c [u32], Result<(), Clash>);

const LIMIT: Duration = Duration::from_secs(20);

/// Whether activations overlap, found by laying all of a hyperperiod out.
fn overlaps(slots: &[SlotSpec], starts_us: &[u32]) -> bool {
    let hyperperiod = hyperperiod_us(slots).expect("small periods");
    let mut taken = vec![false; hyperperiod as usize];
    for (slot, &start_us) in slots.iter().zip(starts_us) {
        for activation in 0..hyperperiod / u64::from(slot.period_us) {
            let begin = activation * u64::from(slot.period_us) + u64::from(start_us);
            for at in begin..begin + u64::from(slot.duration_us) {
                if std::mem::replace(&mut taken[(at % hyperperiod) as usize], true) {
                    return true;
                }
            }
        }
    }
    false
}

/// Whether there is a schedule, found by trying all starts.
fn is_feasible(slots: &[SlotSpec], starts_us: &mut Vec<u32>) -> bool {
    let Some(slot) = slots.get(starts_us.len()) else {
        return true;
    };
    for start_us in 0..slot.period_us {
        starts_us.push(start_us);
        let placed = &slots[..starts_us.len()];
        if !overlaps(placed, starts_us) && is_feasible(slots, starts_us) {
            return true;
        }
        starts_us.pop();
    }
    false
}

#[test]
fn known_sets_and_their_answers() {
    let cases: &[(&str, Times, &str)] = &[
        ("nothing", &[], "feasible"),
        ("one that fills its period", &[(10, 10)], "feasible"),
        ("two that fill all", &[(4, 2), (4, 2)], "feasible"),
        ("gcd 2 for both", &[(4, 1), (6, 1)], "feasible"),
        (
            "relatively prime",
            &[(3, 1), (4, 1)],
            "slots 1 and 2 meet in every 1 us",
        ),
        (
            "a pair",
            &[(4, 1), (6, 2)],
            "slots 1 and 2 meet in every 2 us and last 3 us",
        ),
        (
            "three of which each pair fits",
            &[(4, 1), (6, 1), (10, 1)],
            "slots 1, 2 and 3 meet in every 2 us",
        ),
        (
            "longer than a window in which it meets nobody",
            &[(4, 1), (6, 1), (12, 3)],
            "feasible",
        ),
        (
            "each alone longer than the window in which they meet",
            &[(10, 6), (15, 5)],
            "slots 1 and 2 meet in every 5 us and last 11 us",
        ),
        (
            "too much in all",
            &[(4, 2), (4, 2), (8, 1)],
            "they ask for 112.50 % of the time, most of it slot 1",
        ),
        (
            "longer than its period",
            &[(4, 5)],
            "slot 1 lasts 5 us, its period is 4 us",
        ),
        (
            "no window is crowded",
            &[(4, 1), (4, 1), (4, 1), (6, 1)],
            "slots 1, 2, 3 and 4 overlap in whatever order they come",
        ),
        (
            "harmonic and full",
            &[(2, 1), (4, 1), (8, 1), (8, 1)],
            "feasible",
        ),
        (
            "one without duration beside one that fills all time",
            &[(4, 4), (8, 0)],
            "feasible",
        ),
    ];
    for (name, times_us, expected) in cases {
        let slots = slots(times_us);
        let answer = match solve(&slots, LIMIT) {
            Outcome::Feasible(_) => "feasible".to_owned(),
            Outcome::Infeasible(reason) => reason.to_string(),
            Outcome::Undecided => "undecided".to_owned(),
        };
        assert!(answer.starts_with(expected), "{name}: {answer}");
    }
}

/// What has no duration starts where another slot does, whichever of the two has the shorter
/// period.
#[test]
fn a_slot_without_duration_may_start_where_another_does() {
    for (point_us, other_us) in [(4, 8), (8, 4), (4, 4)] {
        let mut slots = slots(&[(point_us, 0), (other_us, 3)]);
        for start_us in [[0, 0], [0, 4 % other_us]] {
            assert_eq!(check(&slots, &start_us), Ok(()), "{slots:?}");
        }
        assert!(check(&slots, &[2, 0]).is_err(), "within the other");
        slots[0].fixed_start_us = Some(0);
        let outcome = solve(&slots, LIMIT);
        assert!(matches!(outcome, Outcome::Feasible(_)), "{outcome:?}");
    }
}

/// Tables of the kinds that robots have, planted and random ones.
#[test]
fn tables_of_robots_are_decided_at_once() {
    let instances = [
        (
            include_str!("instances/plant_auto_n200_u095_s0.esm"),
            200,
            true,
        ),
        (
            include_str!("instances/rand_robot_n050_u095_s1.esm"),
            50,
            true,
        ),
        (
            include_str!("instances/plant_robot_n100_u095_s0.esm"),
            100,
            true,
        ),
        (
            include_str!("instances/rand_auto_n010_u080_s0.esm"),
            10,
            false,
        ),
        (
            include_str!("instances/rand_harm_n020_u095_s1.esm"),
            20,
            false,
        ),
        (
            include_str!("instances/rand_robot_n020_u095_s2.esm"),
            20,
            false,
        ),
    ];
    for (text, count, is_feasible) in instances {
        let checked = crate::lang::load_text("table.esm", text);
        let slots = checked.slots();
        assert_eq!(slots.len(), count);
        match solve(slots, LIMIT) {
            Outcome::Feasible(schedule) => {
                assert!(is_feasible, "{text}");
                assert_eq!(check(slots, &schedule.starts_us), Ok(()));
                assert_eq!(
                    solve(slots, LIMIT),
                    Outcome::Feasible(schedule),
                    "equal slots, equal answer"
                );
            }
            outcome => assert!(!is_feasible && outcome != Outcome::Undecided, "{text}"),
        }
    }
}

#[test]
fn a_given_start_is_kept() {
    let mut slots = slots(&[(4, 2), (4, 1), (8, 1)]);
    slots[1].fixed_start_us = Some(0);
    let Outcome::Feasible(schedule) = solve(&slots, LIMIT) else {
        panic!("feasible");
    };
    assert_eq!(schedule.starts_us[1], 0);
    assert!(!overlaps(&slots, &schedule.starts_us));
}

#[test]
fn given_starts_that_clash_are_told() {
    let mut slots = slots(&[(4, 2), (8, 2)]);
    slots[0].fixed_start_us = Some(0);
    slots[1].fixed_start_us = Some(5);
    let expected = Infeasibility::FixedStarts {
        first: 1,
        second: 2,
    };
    assert_eq!(solve(&slots, LIMIT), Outcome::Infeasible(expected));
}

#[test]
fn the_checker_finds_what_is_wrong() {
    let table = slots(&[(4, 1), (6, 2)]);
    let fixed = SlotSpec {
        fixed_start_us: Some(1),
        ..slot(1, 4, 1)
    };
    let clash = |first, second| Err(Clash { first, second });
    let cases: &[CheckCase] = &[
        (&table[..1], &[3], Ok(())),
        (&table[..1], &[4], clash(0, 0)),
        (&table, &[0], clash(1, 1)),
        (&table, &[0, 1], clash(0, 1)),
        (&[fixed], &[0], clash(0, 0)),
        (&[slot(1, 4, 1), slot(2, 6, 1)], &[0, 1], Ok(())),
        (&[slot(1, 4, 1), slot(2, 6, 1)], &[0, 2], clash(0, 1)),
    ];
    for (slots, starts_us, expected) in cases {
        assert_eq!(
            check(slots, starts_us),
            *expected,
            "{slots:?} {starts_us:?}"
        );
    }
}

#[test]
fn utilisation_is_compared_exactly() {
    let thirds = [(3, 1), (3, 1), (3, 1)];
    let cases: &[(&[(u32, u32)], bool)] = &[
        (&[], false),
        (&[(1, 1)], false),
        (&[(1, 1), (4_000_000_000, 1)], true),
        (&thirds, false),
        (&[(7, 3), (7, 4)], false),
        (&[(7, 3), (7, 4), (1_000_000_007, 1)], true),
    ];
    for (times_us, expected) in cases {
        assert_eq!(
            exceeds_one(times_us.iter().copied()),
            *expected,
            "{times_us:?}"
        );
    }
}

#[test]
fn the_hyperperiod_may_exceed_64_bits() {
    // Neighbouring numbers have no common divisor.
    let many: Vec<(u32, u32)> = (0..8)
        .map(|index| (3_999_999_000 + 2 * index + 1, 1))
        .collect();
    assert_eq!(hyperperiod_us(&slots(&[(4, 1), (6, 1)])), Some(12));
    assert_eq!(hyperperiod_us(&slots(&many)), None);
    let report = report(&slots(&many), &Outcome::Undecided);
    assert_eq!((report.feasible, report.hyperperiod_us), (None, None));
}

#[test]
fn a_hopeless_search_ends_in_time() {
    // Long periods with small common divisors: neither counting nor trying decides them.
    let times_us: Vec<(u32, u32)> = (0..40)
        .map(|index| (3_999_999_984 - 1_000 * 6 * index, 1))
        .collect();
    let start = work_time::taken();
    solve(&slots(&times_us), Duration::from_millis(200));
    let took = work_time::taken() - start;
    assert!(took < Duration::from_secs(5), "{took:?}");
}

#[test]
fn the_report_has_the_form_that_programs_read() {
    let slots = slots(&[(4, 1), (4, 2)]);
    let outcome = solve(&slots, LIMIT);
    let json = serde_json::to_string(&report(&slots, &outcome)).expect("a report");
    assert_eq!(
        json,
        r#"{"feasible":true,"hyperperiod_us":4,"utilisation":0.75,"slots":[{"slot":1,"start_us":2,"period_us":4,"duration_us":1,"growth_us":1},{"slot":2,"start_us":0,"period_us":4,"duration_us":2,"growth_us":0}],"reason":null,"cure":null,"growth_factor":1.0}"#
    );
}

/// Full tables with harmonic periods, made by cutting time up: there is a schedule, and nothing is
/// left over in it.
#[test]
fn full_harmonic_tables_are_laid_out() {
    for seed in 0..8 {
        let mut random = random::Random::new(seed);
        // Pieces of (period, length): each is cut in two, or every second activation goes to
        // another slot.
        let mut pieces = vec![(4_000_u32, 4_000_u32)];
        while pieces.len() < 40 {
            let at = random.index(pieces.len());
            let (period_us, length_us) = pieces[at];
            if length_us > 500 || (random.once_in(2) && length_us >= 40) {
                let cut_us = 10
                    * (1 + u32::try_from(random.below(u64::from(length_us / 10 - 1)))
                        .expect("small"));
                pieces[at].1 = cut_us;
                pieces.push((period_us, length_us - cut_us));
            } else if period_us < 64_000 {
                pieces[at].0 = 2 * period_us;
                pieces.push(pieces[at]);
            }
        }
        let slots = slots(&pieces);
        let Outcome::Feasible(schedule) = solve(&slots, LIMIT) else {
            panic!("seed {seed} has a schedule");
        };
        assert_eq!(check(&slots, &schedule.starts_us), Ok(()));
    }
}

#[test]
fn a_proof_names_as_few_slots_as_prove_it() {
    // Slot 1 leaves 6 us of each frame of 10 us, twice in 20 us. Of slots 3, 4 and 5 no two fit
    // into one of these.
    let slots = slots(&[(10, 4), (80, 1), (20, 4), (20, 4), (20, 3), (40, 1)]);
    let Outcome::Infeasible(reason) = solve(&slots, LIMIT) else {
        panic!("there is no schedule");
    };
    assert_eq!(
        reason.to_string(),
        "slots 1, 3, 4 and 5 cannot be packed into frames of 10 us"
    );
    // In frames with 7 us left, two of them share a place.
    assert_eq!(
        reason.cure(&slots).to_string(),
        "shorten slot 1 from 4 us to 3 us, or give slot 1 a period of 20 us instead of 10 us"
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// The search agrees with trying everything, and the checker with laying everything out.
    #[test]
    fn answers_are_right(
        times_us in proptest::collection::vec((prop::sample::select(vec![2_u32, 3, 4, 6, 8, 9, 12]), 1..4_u32), 1..5),
    ) {
        let slots = slots(&times_us);
        match solve(&slots, LIMIT) {
            Outcome::Feasible(schedule) => prop_assert!(!overlaps(&slots, &schedule.starts_us)),
            Outcome::Infeasible(_) => {
                let fits = slots.iter().all(|slot| slot.duration_us <= slot.period_us);
                prop_assert!(!fits || !is_feasible(&slots, &mut Vec::new()));
            }
            Outcome::Undecided => prop_assert!(false, "small sets are decided"),
        }
    }

    #[test]
    fn the_checker_is_right(
        times_us in proptest::collection::vec((1..13_u32, 1..4_u32, 0..13_u32), 1..4),
    ) {
        let specs: Vec<(u32, u32)> = times_us.iter().map(|&(period, duration, _)| (period, duration.min(period))).collect();
        let starts_us: Vec<u32> = times_us.iter().map(|&(period, _, start)| start % period).collect();
        let slots = slots(&specs);
        prop_assert_eq!(check(&slots, &starts_us).is_ok(), !overlaps(&slots, &starts_us));
    }
}
