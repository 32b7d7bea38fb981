//! An attacker in the line of a robot with a key gets nothing done, makes its owner believe
//! nothing, and locks nobody out.

use esm_tests::attack::attack;
use esm_tests::environment;

/// What the attacker does in each run of the tests. `cargo xtask campaign line` does a million.
const ATTACKS: u64 = 3_000;

#[test]
fn nobody_in_the_line_commands_a_robot_or_speaks_for_it_or_locks_its_owner_out() {
    let attacks = environment::number("ESM_ATTACKS", ATTACKS);
    let outcome = attack(environment::number("ESM_ATTACK_SEED", 1), attacks);
    println!(
        "{:?}: {} of {} commands done",
        outcome.attacks, outcome.done, outcome.commands
    );
    assert_eq!(outcome.wrong, [""; 0]);
    // The line is bad, and not dead.
    assert!(outcome.done * 10 > outcome.commands, "{outcome:?}");
    assert!(outcome.attacks.total() >= attacks);
}
