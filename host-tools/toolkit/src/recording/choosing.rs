//! The choices of a macro step, told again.

use super::choices::Choices;
use super::retold::{MadeStep, Retold};

/// Those of a macro step of which `retold` is told anew.
pub(super) fn choices_of(
    retold: &mut Retold<'_>,
    made: &MadeStep,
    (stretch, t_us): (usize, u64),
) -> Choices {
    retold.begin(made);
    let mut micro_steps = Vec::new();
    let mut micro = 0;
    while micro < retold.queue.len() {
        let taken: Vec<_> = (made.taken.iter())
            .filter(|taken| usize::from(taken.micro) == micro)
            .copied()
            .collect();
        let is_taken = |region: usize, transition: usize| {
            taken.iter().any(|taken| {
                (taken.region_instance.into(), taken.transition.into()) == (region, transition)
            })
        };
        micro_steps.push(retold.choices(micro, is_taken));
        for taken in &taken {
            retold.take(taken);
        }
        micro += 1;
    }
    Choices {
        stretch,
        step: made.step,
        t_us,
        micro_steps,
    }
}
