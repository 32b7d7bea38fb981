//! What a selftest has found, as a table, as JSON, and as a page for a bug report.

use std::fmt::Write as _;

use serde::Serialize;

use crate::clean::counted;
use crate::link_client::RobotInfo;
use crate::selftest::Finding;

/// What was found of a robot.
#[derive(Debug, Serialize)]
pub struct Report<'r> {
    /// The board that the robot names.
    pub board: &'r str,
    /// Name and version of its firmware.
    pub firmware: &'r str,
    /// Version of this program.
    pub esm: &'static str,
    /// Faults that were planted in a simulated robot.
    pub planted: Vec<String>,
    /// Whether all that was measured is as it should be.
    pub passed: bool,
    /// What was measured, and what was not.
    pub findings: &'r [Finding],
}

impl<'r> Report<'r> {
    /// What was found of this robot.
    pub fn of(info: &'r RobotInfo, planted: Vec<String>, findings: &'r [Finding]) -> Self {
        Report {
            board: &info.board,
            firmware: &info.firmware,
            esm: env!("CARGO_PKG_VERSION"),
            planted,
            passed: findings.iter().all(|it| it.pass != Some(false)),
            findings,
        }
    }

    /// How many are as they should be, are not, and were not measured.
    fn counts(&self) -> [usize; 3] {
        [Some(true), Some(false), None]
            .map(|pass| self.findings.iter().filter(|it| it.pass == pass).count())
    }

    /// In a sentence.
    pub fn verdict(&self) -> String {
        let [good, bad, unmeasured] = self.counts();
        let number = |count: usize| counted(count as u64, "number");
        let left = match unmeasured {
            0 => String::new(),
            count => format!("; {} not measured", number(count)),
        };
        match bad {
            0 => format!("{} as they should be{left}", number(good)),
            bad => format!("{} not as they should be, {good} are{left}", number(bad)),
        }
    }

    /// For a person at a terminal: a line for each, and what to do below it.
    pub fn text(&self) -> String {
        let mut text = format!("{} on the board {}\n\n", self.firmware, self.board);
        for finding in self.findings {
            let verdict = verdict_of(finding);
            // Writing to a string cannot fail.
            let _ = writeln!(
                text,
                "{verdict:<12} {:<18} {:>12}  {}",
                finding.name,
                finding.value_text(),
                finding.limit
            );
            if let Some(advice) = &finding.advice {
                let _ = writeln!(text, "             {advice}");
            }
        }
        let _ = writeln!(text, "\n{}", self.verdict());
        text
    }

    /// A page in Markdown, for a bug report.
    pub fn page(&self) -> String {
        let mut page = format!(
            "# Selftest\n\n| | |\n|---|---|\n| board | {} |\n| firmware | {} |\n| esm | {} |\n",
            cell(self.board),
            cell(self.firmware),
            self.esm
        );
        if !self.planted.is_empty() {
            let _ = writeln!(
                page,
                "| planted faults | {} |",
                cell(&self.planted.join(", "))
            );
        }
        page += "\n| | name | measured | should be | what to do |\n|---|---|---|---|---|\n";
        for finding in self.findings {
            let _ = writeln!(
                page,
                "| {} | {} | {} | {} | {} |",
                verdict_of(finding),
                cell(&finding.name),
                finding.value_text(),
                cell(&finding.limit),
                cell(finding.advice.as_deref().unwrap_or_default())
            );
        }
        let _ = writeln!(page, "\n{}.", self.verdict());
        page
    }
}

fn verdict_of(finding: &Finding) -> &'static str {
    match finding.pass {
        Some(true) => "pass",
        Some(false) => "FAIL",
        None => "not measured",
    }
}

/// Words of others in a cell of a table.
fn cell(text: &str) -> String {
    text.replace('|', "\\|").replace(['\n', '\r'], " ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn findings() -> [Finding; 3] {
        [
            Finding::judged("clock", (12.0, "ppm"), "within 500 ppm", true, ""),
            Finding::judged(
                "battery",
                (6.1, "V"),
                "at least 6.6 V",
                false,
                "charge | it",
            ),
            Finding::not_measured("gyroscope", "no task"),
        ]
    }

    fn report(findings: &[Finding]) -> Report<'_> {
        Report {
            board: "pico|\nx",
            firmware: "esm 1",
            esm: "0",
            planted: vec!["low-battery".to_owned()],
            passed: findings.iter().all(|it| it.pass != Some(false)),
            findings,
        }
    }

    #[test]
    fn a_person_reads_what_is_wrong_and_what_to_do() {
        let findings = findings();
        let text = report(&findings).text();
        assert!(text.contains("FAIL         battery                 6.100 V  at least 6.6 V\n"));
        assert!(text.contains("             charge | it\n"), "{text}");
        assert!(text.ends_with("1 number not as they should be, 1 are; 1 number not measured\n"));
        assert!(report(&findings[..1]).verdict().starts_with("1 number as"));
    }

    #[test]
    fn words_of_others_stay_in_their_cell_of_the_page() {
        let findings = findings();
        let page = report(&findings).page();
        assert!(page.contains("| board | pico\\| x |\n"), "{page}");
        assert!(page.contains("| FAIL | battery | 6.100 V | at least 6.6 V | charge \\| it |\n"));
        assert!(page.contains("| planted faults | low-battery |\n"));
    }
}
