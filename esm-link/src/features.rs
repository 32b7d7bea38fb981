//! What a firmware can be built without, and what a robot says of it with
//! [`Response::Features`](crate::message::Response::Features).

use serde::{Deserialize, Serialize};

/// What a firmware can be built without, as far as a host can ask for it. Each has the number of
/// its bit among [`Features`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Feature {
    /// What enters the interpreter can be recorded.
    Record = 0,
    /// What the firmware logs is kept until the link has sent it.
    Log = 1,
    /// The robot tells status events.
    StatusEvent = 2,
    /// Parameters can be read and changed.
    Params = 3,
    /// A mission can take over warm.
    Warm = 4,
    /// The robot can have a key.
    Keys = 5,
    /// Missions, values of parameters and stops outlast a loss of power.
    Store = 6,
    /// The black box has room for records.
    BlackBox = 7,
    /// Values on nets can be read.
    Telemetry = 8,
    /// There are behaviours.
    Behaviours = 9,
    /// Missions can have links.
    Links = 10,
    /// The board tells what it has measured of itself, and its line can have another rate for a
    /// while.
    Selftest = 11,
}

impl Feature {
    /// All of them, by their bits.
    pub const ALL: [Feature; 12] = [
        Feature::Record,
        Feature::Log,
        Feature::StatusEvent,
        Feature::Params,
        Feature::Warm,
        Feature::Keys,
        Feature::Store,
        Feature::BlackBox,
        Feature::Telemetry,
        Feature::Behaviours,
        Feature::Links,
        Feature::Selftest,
    ];

    /// What a board's crate calls it.
    pub const fn name(self) -> &'static str {
        match self {
            Feature::Record => "record",
            Feature::Log => "log",
            Feature::StatusEvent => "news",
            Feature::Params => "params",
            Feature::Warm => "warm",
            Feature::Keys => "keys",
            Feature::Store => "store",
            Feature::BlackBox => "black-box",
            Feature::Telemetry => "telemetry",
            Feature::Behaviours => "behaviours",
            Feature::Links => "links",
            Feature::Selftest => "selftest",
        }
    }

    const fn bit(self) -> u32 {
        1 << self as u32
    }
}

/// What a firmware has of all [features](Feature): a set of bits. Bits that nobody here knows are
/// kept as they are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Features(pub u32);

impl Features {
    /// Nothing that can be left out.
    pub const NONE: Features = Features(0);

    /// These, and that one if it is there.
    pub const fn with(self, feature: Feature, is_there: bool) -> Self {
        if is_there {
            Features(self.0 | feature.bit())
        } else {
            self
        }
    }

    /// Whether that one is among them.
    pub const fn has(self, feature: Feature) -> bool {
        self.0 & feature.bit() != 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_feature_has_a_bit_of_its_own() {
        for (feature, place) in Feature::ALL.into_iter().zip(0..) {
            assert_eq!(feature.bit(), 1 << place, "{feature:?}");
            let alone = Features::NONE.with(feature, true);
            for other in Feature::ALL {
                assert_eq!(alone.has(other), other == feature, "{feature:?} {other:?}");
            }
            assert_eq!(alone.with(feature, false), alone);
        }
    }
}
