//! Which superstate is around each container instance.

use esm_core::tables::{StateKind, Tables};

/// The region instance and the state of the superstate around each container instance, by the
/// instance's number; none around the machine.
///
/// [`Tables::superstate_of`] looks for one of them through the states of its region: for all of
/// them that would take time in proportion to the square of their number. This is one walk over the
/// states of all instances, whose number is limited.
pub(crate) fn superstates(tables: &Tables<'_>) -> Vec<Option<(usize, usize)>> {
    let mut around = vec![None; tables.instance_count()];
    let regions = 0..tables.region_instance_count();
    for (at, region) in regions.filter_map(|at| Some((at, tables.region_instance(at)?))) {
        for state in region.initial..tables.state_count() {
            match tables.state(state).map(|state| state.kind) {
                Some(StateKind::Super { instance_offset }) => {
                    if let Some(around) = around.get_mut(region.instance + instance_offset) {
                        *around = Some((at, state));
                    }
                }
                Some(StateKind::Final) | None => break,
                _ => {}
            }
        }
    }
    around
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::directory_and_blob;

    #[test]
    fn they_are_those_that_the_tables_find_one_by_one() {
        let (_, blob) = directory_and_blob(
            "interpreter slot 1; slot 1 period 10 ms duration 1 ms;
            container Leaf { region a { state S; initial -> S; S -> final; } }
            container Twig {
                region a { state Before; super L: Leaf; state Between; super K: Leaf; initial -> L; L -> K on *; K -> Before; Before -> Between; }
                region b { super M: Leaf; initial -> M; M -> final on *; }
            }
            machine Tree {
                region r { super One: Twig; super Two: Twig; initial -> One; One -> Two on *; Two -> One on *; }
                region s { super Three: Leaf; initial -> Three; Three -> Three on *; }
            }",
        );
        let verified = esm_core::verify(blob.as_slice()).unwrap();
        let tables = verified.tables();
        let found = superstates(&tables);
        assert_eq!(found.len(), 10);
        assert_eq!(found.iter().filter(|around| around.is_none()).count(), 1);
        for (instance, around) in found.into_iter().enumerate() {
            assert_eq!(around, tables.superstate_of(instance), "{instance}");
        }
    }
}
