//! Values of parameters that a host changed while the mission runs.
//!
//! The mission's own values stand in its blob, which nobody writes. Beside it is kept what differs:
//! so a mission that starts, or starts anew, has the values of its blob again, but for values that
//! were saved for it. A parameter belongs to a task state of a container, so that a value is that
//! of all its instances at once.

use esm_core::tables::Tables;

use crate::features::PARAMS;
use crate::ports::Registry;
use crate::task::{ParamDeclaration, ParamKind};
use esm_link::message::LinkError;

/// How many parameters of a mission can differ from its blob at the same time.
pub const MAX_CHANGED: usize = if PARAMS { 8 } else { 0 };

/// A place that no value is in. No parameter has this index, since a table has less than 65,535
/// records.
const FREE: u16 = u16::MAX;

/// The parameters that differ from the mission's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct LiveParams {
    /// Which, by their indices in the blob.
    params: [u16; MAX_CHANGED],
    /// Bits of their values, in the same order.
    values: [u32; MAX_CHANGED],
    /// Whether there is one.
    any: bool,
}

impl LiveParams {
    /// All are as the mission says.
    pub(crate) const NONE: LiveParams = LiveParams {
        params: [FREE; MAX_CHANGED],
        values: [0; MAX_CHANGED],
        any: false,
    };

    /// Whether any differ.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn is_any(&self) -> bool {
        self.any
    }

    /// How many differ.
    pub(crate) fn len(&self) -> u8 {
        self.params.iter().filter(|param| **param != FREE).count() as u8
    }

    /// The value of a parameter, if it differs.
    pub(crate) fn get(&self, param: u16) -> Option<u32> {
        let mut kept = self.params.iter().zip(&self.values);
        kept.find(|(kept, _)| **kept == param)
            .map(|(_, value)| *value)
    }

    /// Whether there is a place for a value of this parameter.
    pub(crate) fn has_room(&self, param: u16) -> Result<(), LinkError> {
        match self.place(param) {
            Some(_) => Ok(()),
            None => Err(LinkError::TooManyParams {
                available: MAX_CHANGED as u8,
            }),
        }
    }

    /// Changes a parameter; with the value that the mission gives it, it differs no more. Nothing
    /// happens where there is no [room](Self::has_room).
    pub(crate) fn set(&mut self, param: u16, value: u32, of_mission: u32) {
        let Some(place) = self.place(param) else {
            return;
        };
        let kept = if value == of_mission { FREE } else { param };
        if let (Some(param), Some(bits)) = (self.params.get_mut(place), self.values.get_mut(place))
        {
            *param = kept;
            *bits = value;
        }
        self.any = self.params.iter().any(|param| *param != FREE);
    }

    /// Where the value of this parameter is, or can be.
    fn place(&self, param: u16) -> Option<usize> {
        let at = |wanted: u16| self.params.iter().position(|kept| *kept == wanted);
        at(param).or_else(|| at(FREE))
    }

    /// Puts the values that differ in the places of the mission's: `values` are those of a task,
    /// the first of which has the index `first`.
    #[inline(never)]
    pub(crate) fn put_into(&self, values: &mut [u32], first: u16) {
        for (param, value) in self.params.iter().zip(&self.values) {
            let place = param.checked_sub(first).map(usize::from);
            if let Some(bits) = place.and_then(|place| values.get_mut(place))
                && *param != FREE
            {
                *bits = *value;
            }
        }
    }
}

/// Values of parameters that were saved for a mission, which starts with them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SavedParams {
    /// The mission's hash.
    mission: u32,
    values: LiveParams,
}

impl SavedParams {
    /// Nothing was saved.
    pub const NONE: SavedParams = SavedParams {
        mission: 0,
        values: LiveParams::NONE,
    };
    /// Bytes of as many values as there can be.
    pub const MAX_BYTES: usize = HASH_BYTES + MAX_CHANGED * VALUE_BYTES;

    /// What differs now from the values of the mission of this hash.
    pub(crate) fn new(mission: u32, values: LiveParams) -> Self {
        SavedParams { mission, values }
    }

    /// Takes the place of these values. Part by part: where whole ones might overlap, a library
    /// routine would copy them, which takes a kilobyte and a half of flash.
    pub(crate) fn assign(&mut self, others: &SavedParams) {
        self.mission = others.mission;
        let (values, others) = (&mut self.values, &others.values);
        values.params.copy_from_slice(&others.params);
        values.values.copy_from_slice(&others.values);
        values.any = others.any;
    }

    /// The values for the mission of this hash.
    pub(crate) fn of(&self, mission: u32) -> &LiveParams {
        match self.mission == mission {
            true => &self.values,
            false => &LiveParams::NONE,
        }
    }

    /// How many there are.
    pub(crate) fn len(&self) -> u8 {
        self.values.len()
    }

    /// As bytes: the mission's hash, then of each value the parameter's index (two bytes) and its
    /// bits (four), all little endian. No bytes where there is no value.
    pub fn put_into<'r>(&self, room: &'r mut [u8; Self::MAX_BYTES]) -> &'r [u8] {
        let (hash, places) = room.split_at_mut(HASH_BYTES);
        hash.copy_from_slice(&self.mission.to_le_bytes());
        let (places, _) = places.as_chunks_mut::<VALUE_BYTES>();
        let values = self.values.params.iter().zip(&self.values.values);
        let mut len = 0;
        for (place, (param, value)) in places
            .iter_mut()
            .zip(values.filter(|(param, _)| **param != FREE))
        {
            let [low, high] = param.to_le_bytes();
            let [a, b, c, d] = value.to_le_bytes();
            *place = [low, high, a, b, c, d];
            len += VALUE_BYTES;
        }
        match len {
            0 => &[],
            len => room.get(..HASH_BYTES + len).unwrap_or_default(),
        }
    }

    /// From [bytes](Self::put_into). What is not whole at their end is passed over.
    pub fn from_bytes(bytes: &[u8]) -> Self {
        let mut saved = Self::NONE;
        let Some((hash, values)) = bytes.split_first_chunk() else {
            return saved;
        };
        saved.mission = u32::from_le_bytes(*hash);
        let places = (saved.values.params.iter_mut()).zip(&mut saved.values.values);
        let (values, _) = values.as_chunks::<VALUE_BYTES>();
        for ((param, value), [low, high, a, b, c, d]) in places.zip(values) {
            *param = u16::from_le_bytes([*low, *high]);
            *value = u32::from_le_bytes([*a, *b, *c, *d]);
        }
        saved
    }
}

const HASH_BYTES: usize = size_of::<u32>();
/// Index and bits.
const VALUE_BYTES: usize = size_of::<u16>() + size_of::<u32>();

/// Gives a mission that starts the values that were saved for it, as far as the firmware's tasks
/// take them: it may be another firmware than the one that saved them.
// Not inlined: it is seldom that there are some.
#[inline(never)]
pub(crate) fn restore(
    params: &mut LiveParams,
    saved: &LiveParams,
    tables: &Tables<'_>,
    registry: Registry<'_>,
) {
    for (param, value) in saved.params.iter().zip(&saved.values) {
        if let Some(of_mission) = tables.param(usize::from(*param))
            && declared(tables, registry, *param)
                .is_some_and(|declared| check(declared, *value).is_ok())
        {
            params.set(*param, *value, of_mission);
        }
    }
}

/// What the firmware's own task declares of a parameter of the mission.
pub(crate) fn declared(
    tables: &Tables<'_>,
    registry: Registry<'_>,
    param: u16,
) -> Option<&'static ParamDeclaration> {
    (0..tables.task_state_count()).find_map(|index| {
        let state = tables.task_state(index)?;
        let place = usize::from(param).checked_sub(state.first_param)?;
        let task = tables.task(state.task)?;
        if place >= task.ports.params {
            return None;
        }
        let bank = registry.find(task.signature_hash)?;
        registry.declaration(usize::from(bank))?.params.get(place)
    })
}

/// Whether a value, given by its bits, is one that the task takes.
///
/// # Errors
/// [`LinkError::ParamNoValue`] for bits that are no value of the type, NaN and the infinities among
/// them; [`LinkError::ParamOutside`].
pub(crate) fn check(declared: &ParamDeclaration, bits: u32) -> Result<(), LinkError> {
    let is_value = match declared.kind {
        ParamKind::Bool => bits <= 1,
        ParamKind::F32 => f32::from_bits(bits).is_finite(),
        ParamKind::I32 | ParamKind::U32 => true,
    };
    match declared.bounds {
        _ if !is_value => Err(LinkError::ParamNoValue),
        Some([min, max]) if !declared.admits(bits) => Err(LinkError::ParamOutside { min, max }),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_differs_is_put_in_the_place_of_the_missions_values() {
        let mut live = LiveParams::NONE;
        live.set(3, 30, 0);
        live.set(5, 50, 0);
        live.set(3, 31, 0);
        assert_eq!(
            [live.get(3), live.get(4), live.get(5)],
            [Some(31), None, Some(50)]
        );
        for (first, expected) in [
            (0, [1, 2, 3]),
            (3, [31, 2, 50]),
            (4, [1, 50, 3]),
            (6, [1, 2, 3]),
        ] {
            let mut values = [1, 2, 3];
            live.put_into(&mut values, first);
            assert_eq!(values, expected, "from {first} on");
        }
        let mut last = [1, 2];
        live.put_into(&mut last, FREE - 1);
        assert_eq!(last, [1, 2], "places without a value are no parameters");
    }

    #[test]
    fn the_missions_own_value_differs_no_more_and_makes_room() {
        let mut live = LiveParams::NONE;
        for param in 0..MAX_CHANGED as u16 {
            assert_eq!(live.has_room(param), Ok(()));
            live.set(param, 7, 0);
        }
        assert_eq!(usize::from(live.len()), MAX_CHANGED);
        let refused = Err(LinkError::TooManyParams {
            available: MAX_CHANGED as u8,
        });
        assert_eq!(live.has_room(100), refused);
        assert_eq!(
            live.has_room(2),
            Ok(()),
            "one that differs can change again"
        );
        live.set(2, 0, 0);
        assert_eq!(live.get(2), None);
        assert_eq!(live.has_room(100), Ok(()));
    }

    #[test]
    fn a_task_takes_values_of_its_type_within_its_bounds() {
        let declared = |kind, bounds| ParamDeclaration {
            name: "p",
            kind,
            bounds,
            attributes: "",
            docs: crate::__task_docs!(),
        };
        let f32 = |value: f32| value.to_bits();
        let outside = |min, max| Err(LinkError::ParamOutside { min, max });
        let (least, greatest) = (f32(-1.0), f32(0.5));
        let speed = declared(ParamKind::F32, Some([least, greatest]));
        let free = declared(ParamKind::F32, None);
        let steps = declared(ParamKind::I32, Some([(-2_i32).cast_unsigned(), 3]));
        let switch = declared(ParamKind::Bool, None);
        for (declared, bits, expected) in [
            (&speed, least, Ok(())),
            (&speed, greatest, Ok(())),
            (&speed, f32(0.500_001), outside(least, greatest)),
            (&speed, f32(f32::NAN), Err(LinkError::ParamNoValue)),
            (&free, f32(1e30), Ok(())),
            (&free, f32(f32::NAN), Err(LinkError::ParamNoValue)),
            (&free, f32(f32::INFINITY), Err(LinkError::ParamNoValue)),
            (&steps, (-2_i32).cast_unsigned(), Ok(())),
            (
                &steps,
                (-3_i32).cast_unsigned(),
                outside((-2_i32).cast_unsigned(), 3),
            ),
            (&steps, 4, outside((-2_i32).cast_unsigned(), 3)),
            (&switch, 1, Ok(())),
            (&switch, 2, Err(LinkError::ParamNoValue)),
        ] {
            assert_eq!(check(declared, bits), expected, "{declared:?} {bits:#x}");
        }
    }
}
