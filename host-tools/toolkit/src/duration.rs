//! A length of time, in words.

/// A length of time, exactly, with the unit that makes it short: `250 µs`, `2.5 ms`, `1330 s`.
pub fn time(us: u64) -> String {
    let (unit, per_unit, digits) = match us {
        ..1_000 => ("µs", 1, 0),
        1_000..1_000_000 => ("ms", 1_000, 3),
        _ => ("s", 1_000_000, 6),
    };
    let (whole, rest) = (us / per_unit, us % per_unit);
    if rest == 0 {
        return format!("{whole} {unit}");
    }
    let decimals = format!("{rest:0digits$}");
    format!("{whole}.{} {unit}", decimals.trim_end_matches('0'))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_short_and_exact() {
        for (us, text) in [
            (0, "0 µs"),
            (999, "999 µs"),
            (2_500, "2.5 ms"),
            (20_000, "20 ms"),
            (1_000_001, "1.000001 s"),
            (1_330_000_000, "1330 s"),
            (u64::MAX, "18446744073709.551615 s"),
        ] {
            assert_eq!(time(us), text);
        }
    }
}
