//! A guard back to an expression.
//!
//! A program that comes from `and`, `or` and `not` can always be folded: two tests in a row, of
//! which nothing else jumps to the second, are one test if both jump to the same place (`or`), or
//! if the first jumps to where the second goes on (`and not`). What cannot be folded to a single
//! test was not made by this compiler, and is shown as it stands.
//!
//! What is folded compiles to the code that it came from: the compiler looks through nesting and
//! negation, so that it makes the same tests of all expressions that have the same flags in the
//! same order, joined by the same words.

use std::fmt::{self, Display, Formatter};

/// Deeper nesting than this is not folded. The language's parentheses go less deep.
const MAX_DEPTH: usize = 256;

/// A guard. The negation of a whole expression is one bit, so that folding never walks through what
/// it has built.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Expression {
    is_negated: bool,
    body: Body,
    /// Levels of `and` and `or`.
    depth: usize,
}

#[derive(Clone, Debug, PartialEq)]
enum Body {
    /// A flag.
    Flag(String),
    /// All are true. Negated, it is an `or` of what is the opposite of each.
    And(Vec<Expression>),
}

/// What a transition asks for.
#[derive(Clone, Debug)]
pub(super) enum Written {
    /// No guard.
    Nothing,
    /// An expression.
    Expression(Expression),
    /// A program that is none.
    Tests(Vec<Test>),
}

/// A test of a program.
#[derive(Clone, Debug)]
pub(super) struct Test {
    /// Jumps if this is true.
    pub jumps_if: Expression,
    /// Where to, as an index into the tests; their number where the guard is true; `None` where it
    /// is false.
    pub to: Option<usize>,
}

impl Expression {
    /// A flag that is tested for a value.
    pub(super) fn flag(name: String, value: bool) -> Self {
        Self {
            is_negated: !value,
            body: Body::Flag(name),
            depth: 0,
        }
    }

    fn negated(mut self) -> Self {
        self.is_negated = !self.is_negated;
        self
    }

    /// The terms of an `and` and how deep it goes; everything else is its only term.
    fn into_terms(self) -> (Vec<Self>, usize) {
        match self.body {
            Body::And(terms) if !self.is_negated => (terms, self.depth),
            _ => {
                let depth = self.depth + 1;
                (vec![self], depth)
            }
        }
    }

    pub(super) fn and(self, other: Self) -> Self {
        let (mut terms, depth) = self.into_terms();
        // What comes second is mostly one term.
        let (more, more_depth) = other.into_terms();
        terms.extend(more);
        Self {
            is_negated: false,
            body: Body::And(terms),
            depth: depth.max(more_depth),
        }
    }

    fn or(self, other: Self) -> Self {
        self.negated().and(other.negated()).negated()
    }

    /// Writes it, or its opposite.
    fn write(&self, is_opposite: bool, f: &mut Formatter<'_>) -> fmt::Result {
        let is_negated = self.is_negated != is_opposite;
        let terms = match &self.body {
            Body::Flag(name) if is_negated => return write!(f, "not {name}"),
            Body::Flag(name) => return f.write_str(name),
            Body::And(terms) => terms,
        };
        for (index, term) in terms.iter().enumerate() {
            if index > 0 {
                f.write_str(if is_negated { " or " } else { " and " })?;
            }
            let is_or = matches!(term.body, Body::And(_)) && term.is_negated != is_negated;
            // Only an `or` inside an `and` needs parentheses.
            if is_or {
                f.write_str("(")?;
            }
            term.write(is_negated, f)?;
            if is_or {
                f.write_str(")")?;
            }
        }
        Ok(())
    }
}

impl Display for Expression {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        self.write(false, f)
    }
}

/// The expression of a program, if it is one.
pub(super) fn fold(tests: Vec<Test>) -> Option<Expression> {
    let accept = tests.len();
    // How many of the tests kept so far jump to each place.
    let mut jumps_to = vec![0_usize; accept + 1];
    // Folded tests keep the position of their last part, behind which they go on.
    let mut folded: Vec<(usize, Test)> = Vec::new();
    for (position, test) in tests.into_iter().enumerate() {
        count(&mut jumps_to, test.to, 1);
        let mut last = (position, test);
        while let Some((first_end, first)) = folded.pop() {
            let (end, second) = last;
            // What comes later cannot jump back, so only the tests kept so far could jump between
            // the two.
            let between = Some(first_end + 1);
            let own = usize::from(first.to == between) + usize::from(second.to == between);
            let others = jumps_to.get(first_end + 1).map_or(0, |count| count - own);
            let joins_as_or = first.to == second.to;
            let joins_as_and = first.to == Some(end + 1);
            let depth = first.jumps_if.depth.max(second.jumps_if.depth);
            if others > 0 || !(joins_as_or || joins_as_and) || depth >= MAX_DEPTH {
                folded.push((first_end, first));
                last = (end, second);
                break;
            }
            count(&mut jumps_to, first.to, -1);
            let jumps_if = if joins_as_or {
                first.jumps_if.or(second.jumps_if)
            } else {
                first.jumps_if.negated().and(second.jumps_if)
            };
            let to = second.to;
            last = (end, Test { jumps_if, to });
        }
        folded.push(last);
    }
    let (end, test) = folded.pop()?;
    let is_whole = folded.is_empty() && test.to.is_none() && end + 1 == accept;
    is_whole.then(|| test.jumps_if.negated())
}

fn count(jumps_to: &mut [usize], to: Option<usize>, change: isize) {
    if let Some(count) = to.and_then(|to| jumps_to.get_mut(to)) {
        *count = count.saturating_add_signed(change);
    }
}

/// The tests one by one.
pub(super) fn listing(tests: &[Test]) -> String {
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
