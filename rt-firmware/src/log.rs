//! Log macros that cost nothing where nobody listens: [`error!`](crate::error!),
//! [`warn!`](crate::warn!), [`info!`](crate::info!) and [`debug!`](crate::debug!).
//!
//! With the feature `defmt` they are defmt's, with `log` those of the log crate, else they only
//! evaluate their arguments. Formats use plain `{}` alone, which all of them understand. A crate
//! that uses them with a feature on depends on `defmt` or `log` itself.

/// One log macro for each level, all alike.
macro_rules! levels {
    ($dollar:tt: $($level:ident)*) => {
        $(
            #[doc = concat!("Logs at level *", stringify!($level), "*.")]
            #[cfg(feature = "defmt")]
            #[macro_export]
            macro_rules! $level {
                ($dollar($dollar argument:tt)*) => { ::defmt::$level!($dollar($dollar argument)*) };
            }

            #[doc = concat!("Logs at level *", stringify!($level), "*.")]
            #[cfg(all(feature = "log", not(feature = "defmt")))]
            #[macro_export]
            macro_rules! $level {
                ($dollar($dollar argument:tt)*) => { ::log::$level!($dollar($dollar argument)*) };
            }

            #[doc = concat!("Logs at level *", stringify!($level), "*.")]
            #[cfg(not(any(feature = "log", feature = "defmt")))]
            #[macro_export]
            macro_rules! $level {
                ($dollar format:literal $dollar(, $dollar argument:expr)* $dollar(,)?) => {{
                    $dollar(let _ = &$dollar argument;)*
                }};
            }
        )*
    };
}

levels!($: error warn info debug);
