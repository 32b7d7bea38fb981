//! Where each 16-bit field of a record is, and of some 32-bit ones the low half. The tables with
//! their meaning stand in [`crate::format`].

use crate::format::Section;

/// A 16-bit field of the records of a section, in one small number: most calls that name one load
/// it in two bytes of code.
#[derive(Clone, Copy)]
pub(crate) struct Field(u16);

impl Field {
    const NUMBER_BITS: u16 = 4;

    const fn new(section: Section, number: u16) -> Self {
        Self((section as u16) << Self::NUMBER_BITS | number)
    }

    /// The first field of the section with this number.
    pub(crate) const fn first_at(section: u8) -> Self {
        Self((section as u16) << Self::NUMBER_BITS)
    }

    /// The field behind, which must be in the same record.
    pub(crate) fn next(self) -> Self {
        Self(self.0 + 1)
    }

    /// The section, as an index into [`Section::ALL`].
    pub(crate) fn section(self) -> usize {
        usize::from(self.0 >> Self::NUMBER_BITS)
    }

    /// Its place among the 16-bit words of the record.
    pub(crate) const fn number(self) -> usize {
        (self.0 & ((1 << Self::NUMBER_BITS) - 1)) as usize
    }

    /// First byte of the field in the record.
    pub(crate) fn offset(self) -> usize {
        2 * self.number()
    }
}

macro_rules! fields {
    ($( $record:ident: $section:ident { $($number:literal $field:ident)* } )*) => {
        $(
            pub(crate) mod $record {
                use super::{Field, Section};
                $( pub(crate) const $field: Field = Field::new(Section::$section, $number); )*
            }
        )*
    };
}

fields! {
    slot: Slots {
        0 NUMBER 2 PERIOD 4 DURATION 6 START
    }
    listener: Listeners {
        0 REGIONS
    }
    mission: Mission {
        0 QUEUE 1 INTERPRETER_SLOT 2 EVENTS 3 FLAGS 4 EXCLUSIVE_GROUPS
    }
    container: Containers {
        0 FIRST_REGION 1 FLAGS 2 CHANNELS 3 FIRST_INSTANCE
        4 FLAG_SPAN 5 TASK_SPAN 6 REGION_SPAN 7 INSTANCE_SPAN
    }
    region: Regions {
        0 FIRST_STATE 1 CONTAINER
    }
    state: States {
        0 EVENTS 1 EVENTS_HIGH 2 FIRST_TRANSITION 3 FIRST_EVENT_TRANSITION 4 FIRST_FLAG
        5 SHAPE 6 A 7 B
    }
    transition: Transitions {
        0 EVENT 1 TARGET 2 GUARD 3 ACTION
    }
    code: Code {
        0 OPERAND 1 CONTROL
    }
    mask: Code {
        0 MASK 1 VALUE
    }
    timer: Timers {
        0 TIMEOUT
    }
    instance: Instances {
        0 CONTAINER 1 FIRST_REGION 2 FIRST_FLAG 3 FIRST_CHANNEL 4 FIRST_TASK 5 AROUND
    }
    region_instance: RegionInstances {
        0 NEXT 1 FIRST_FLAG 2 INITIAL 3 INSTANCE
    }
    channel: Channels {
        0 EVENT 1 FIRST_ROW_WORD 2 FIRST_REGION_WORD 3 REGION_WORDS
    }
    task: Tasks {
        4 TEXT_START 5 TEXT_LENGTH 6 EXCLUSIVE 7 DATA 8 FLAGS 9 PARAMS
    }
    task_state: TaskStates {
        0 TASK 1 SLOT 2 FIRST_PARAM 3 STATE
    }
    task_instance: TaskInstances {
        0 STATE 1 REGION 2 FIRST_CONNECTION 3 FIRST_FLAG 4 TASK_STATE
    }
    connection: Connections {
        0 NET
    }
}
