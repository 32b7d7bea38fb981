//! Makes a failing text smaller: takes lines away for as long as it still fails.

/// The smallest text found, by leaving out runs of lines, longest first, for which `fails` still
/// holds. At most `budget` calls of `fails`.
pub fn shrink(text: &str, budget: usize, mut fails: impl FnMut(&str) -> bool) -> String {
    let mut lines: Vec<&str> = text.lines().collect();
    let mut calls = 0;
    let mut run = lines.len() / 2;
    while run > 0 {
        let mut start = 0;
        let mut smaller = false;
        while start < lines.len() && calls < budget {
            let end = (start + run).min(lines.len());
            let candidate: Vec<&str> = [&lines[..start], &lines[end..]].concat();
            calls += 1;
            if fails(&candidate.join("\n")) {
                lines = candidate;
                smaller = true;
            } else {
                start += 1;
            }
        }
        // One more round of the same length may succeed now; else shorter runs.
        if !smaller || calls >= budget {
            run = if run > 8 { run / 2 } else { run - 1 };
        }
    }
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::shrink;

    #[test]
    fn what_does_not_matter_is_left_out() {
        let text = (0..50).map(|n| format!("line {n}\n")).collect::<String>();
        let small = shrink(&text, 2_000, |text| {
            text.contains("line 7\n") && text.contains("line 31")
        });
        assert_eq!(small, "line 7\nline 31");
    }

    #[test]
    fn a_budget_ends_the_search() {
        let mut calls = 0;
        shrink(&"x\n".repeat(500), 20, |_| {
            calls += 1;
            false
        });
        assert_eq!(calls, 20);
    }
}
