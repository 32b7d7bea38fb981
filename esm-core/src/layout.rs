//! Which 16-bit field of a record is what. The tables with their meaning stand in [`crate::format`].

macro_rules! fields {
    ($( $record:ident { $($field:ident)* } )*) => {
        $(
            pub(crate) mod $record {
                fields!(@number 0, $($field)*);
            }
        )*
    };
    (@number $number:expr, ) => {};
    // A 64-bit field, or one that is never read by its number, is passed over with `_`-named places of its own.
    (@number $number:expr, $field:ident $($rest:ident)*) => {
        #[allow(dead_code, reason = "numbered for those that come after it")]
        pub(crate) const $field: usize = $number;
        fields!(@number $number + 1, $($rest)*);
    };
}

fields! {
    mission { QUEUE INTERPRETER_SLOT EVENTS FLAGS EXCLUSIVE_GROUPS }
    container { FIRST_REGION FLAGS CHANNELS FIRST_INSTANCE FLAG_SPAN TASK_SPAN REGION_SPAN INSTANCE_SPAN }
    region { FIRST_STATE CONTAINER }
    state { FIRST_TRANSITION FIRST_EVENT_TRANSITION FIRST_FLAG SHAPE A B TIMEOUT_LOW TIMEOUT_HIGH }
    transition { EVENT TARGET CODE }
    code { OPERAND CONTROL }
    instance { CONTAINER FIRST_REGION FIRST_FLAG FIRST_CHANNEL FIRST_TASK END_TASK PARENT_REGION PARENT_STATE }
    region_instance { NEXT FIRST_FLAG INITIAL INSTANCE }
    task { HASH_0 HASH_1 HASH_2 HASH_3 TEXT_START TEXT_LENGTH EXCLUSIVE DATA FLAGS PARAMS }
    task_state { TASK SLOT FIRST_PARAM }
    task_instance { STATE REGION FIRST_CONNECTION }
}
