//! A guard's code back to an expression.
//!
//! Code that comes from `and`, `or` and `not` can always be folded: two tests in a row, of which nothing else jumps to the second, are one test if
//! both jump to the same place (`or`), or if the first jumps to where the second goes on (`and not`). What cannot be folded to a single test
//! was not made by this compiler, and is shown as it stands.

/// A guard.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Expression {
    /// A flag.
    Flag(String),
    /// Its negation.
    NotFlag(String),
    /// All are true.
    And(Vec<Expression>),
    /// One is true.
    Or(Vec<Expression>),
}

/// A test of a guard.
#[derive(Clone, Debug)]
pub(super) struct Test {
    /// Jumps if this is true.
    pub jumps_if: Expression,
    /// Where to, as an index into the tests; their number where the guard is true; `None` where it is false.
    pub to: Option<usize>,
}

impl Expression {
    /// A flag that is tested for a value.
    pub(super) fn flag(name: String, value: bool) -> Self {
        if value {
            Self::Flag(name)
        } else {
            Self::NotFlag(name)
        }
    }

    fn negated(self) -> Self {
        let all = |terms: Vec<Self>| terms.into_iter().map(Self::negated).collect();
        match self {
            Self::Flag(name) => Self::NotFlag(name),
            Self::NotFlag(name) => Self::Flag(name),
            Self::And(terms) => Self::Or(all(terms)),
            Self::Or(terms) => Self::And(all(terms)),
        }
    }

    fn and(self, other: Self) -> Self {
        let mut terms = match self {
            Self::And(terms) => terms,
            term => vec![term],
        };
        match other {
            Self::And(more) => terms.extend(more),
            term => terms.push(term),
        }
        Self::And(terms)
    }

    fn or(self, other: Self) -> Self {
        self.negated().and(other.negated()).negated()
    }
}

impl std::fmt::Display for Expression {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (terms, word) = match self {
            Self::Flag(name) => return f.write_str(name),
            Self::NotFlag(name) => return write!(f, "not {name}"),
            Self::And(terms) => (terms, " and "),
            Self::Or(terms) => (terms, " or "),
        };
        for (index, term) in terms.iter().enumerate() {
            if index > 0 {
                f.write_str(word)?;
            }
            match term {
                // Only an `or` inside an `and` needs parentheses.
                Self::Or(_) => write!(f, "({term})")?,
                _ => write!(f, "{term}")?,
            }
        }
        Ok(())
    }
}

/// The expression of a guard, as text. The tests are not empty.
pub(super) fn text(tests: &[Test]) -> String {
    match fold(tests) {
        Some(expression) => expression.to_string(),
        None => listing(tests),
    }
}

/// Folds tests as long as two of them can be.
fn fold(tests: &[Test]) -> Option<Expression> {
    let accept = tests.len();
    // Folded tests keep the position of their last part, behind which they go on.
    let mut folded: Vec<(usize, Test)> = Vec::new();
    for (position, test) in tests.iter().enumerate() {
        folded.push((position, test.clone()));
        while let [.., (first_end, first), (second_end, second)] = &folded[..] {
            let behind = second_end + 1;
            // What comes later cannot jump back, so only the tests kept so far could jump between the two.
            let between = first_end + 1;
            let earlier = &folded[..folded.len() - 2];
            if earlier.iter().any(|(_, test)| test.to == Some(between)) {
                break;
            }
            let (one, two) = (first.jumps_if.clone(), second.jumps_if.clone());
            let jumps_if = if first.to == second.to {
                one.or(two)
            } else if first.to == Some(behind) {
                one.negated().and(two)
            } else {
                break;
            };
            let merged = (
                *second_end,
                Test {
                    jumps_if,
                    to: second.to,
                },
            );
            folded.truncate(folded.len() - 2);
            folded.push(merged);
        }
    }
    match &folded[..] {
        [(end, test)] if test.to.is_none() && end + 1 == accept => {
            Some(test.jumps_if.clone().negated())
        }
        _ => None,
    }
}

/// The tests one by one.
fn listing(tests: &[Test]) -> String {
    let lines = tests.iter().enumerate().map(|(position, test)| {
        let to = match test.to {
            None => "false".to_owned(),
            Some(to) if to == tests.len() => "true".to_owned(),
            Some(to) => to.to_string(),
        };
        format!("{position}: {} -> {to}", test.jumps_if)
    });
    lines.collect::<Vec<_>>().join("; ")
}
