//! Whether guards can be true, alone, together, or after others were not.
//!
//! A guard says yes or no for each choice of the flags that it reads. Here it becomes a decision
//! diagram: a node asks for one flag and leads on to two others, until one of the two ends says
//! what the guard says. With a fixed order of the flags and no node twice, equal guards are the
//! same node, and a guard that can never be true is the end "no". (Bryant 1986 describes these
//! diagrams.)
//!
//! Diagrams can be exponentially large, so all work is counted. Whoever asks gets [`TooLarge`]
//! where [`MAX_ATOMS`] or the steps given do not suffice, and says nothing then that could be
//! wrong.

use std::collections::HashMap;

use crate::model::Guard;

/// The most different flags in the guards that are looked at together. It bounds the depth of the
/// recursion here.
pub const MAX_ATOMS: usize = 200;

/// What a guard reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Atom {
    /// `exit`
    Exit,
    /// `timeout`
    Timeout,
    /// `busy`
    Busy,
    /// `.F`, by index
    Own(usize),
    /// `^F`, by index
    Parent(usize),
}

/// The question was too large to be answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooLarge;

/// A guard as a node of a [`Diagrams`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Formula(u32);

impl Formula {
    /// What is never true.
    pub const NEVER: Formula = Formula(0);
    /// What is always true.
    pub const ALWAYS: Formula = Formula(1);

    /// Whether some choice of flags makes it true.
    pub fn can_be_true(self) -> bool {
        self != Formula::NEVER
    }
}

/// A question about one flag. Those of flags that come later in the order stand below it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Node {
    atom: u32,
    if_not: Formula,
    if_so: Formula,
}

/// The diagrams of guards that are looked at together: those of one state on one event.
#[derive(Debug, Default)]
pub struct Diagrams {
    /// In the order in which they were first read.
    atoms: Vec<Atom>,
    order: HashMap<Atom, u32>,
    /// The node of [`Formula`] `n` is at `n - 2`.
    nodes: Vec<Node>,
    known: HashMap<Node, Formula>,
    chosen: HashMap<(Formula, Formula, Formula), Formula>,
    steps: usize,
    steps_left: usize,
}

impl Diagrams {
    /// Forgets everything and allows `steps` steps from here on.
    pub fn restart(&mut self, steps: usize) {
        self.atoms.clear();
        self.order.clear();
        self.nodes.clear();
        self.known.clear();
        self.chosen.clear();
        self.steps = 0;
        self.steps_left = steps;
    }

    /// Steps taken since the last [`Diagrams::restart`].
    pub fn steps(&self) -> usize {
        self.steps
    }

    fn step(&mut self) -> Result<(), TooLarge> {
        self.steps_left = self.steps_left.checked_sub(1).ok_or(TooLarge)?;
        self.steps += 1;
        Ok(())
    }

    /// The diagram of a guard, where atoms for which `is_never` holds are false. The depth of the
    /// recursion is that of the guard, which the parser bounds.
    ///
    /// # Errors
    /// There are too many flags, or no steps are left.
    pub fn guard(
        &mut self,
        guard: &Guard,
        is_never: &impl Fn(Atom) -> bool,
    ) -> Result<Formula, TooLarge> {
        self.step()?;
        let atom = match guard {
            Guard::Not(inner) => {
                let inner = self.guard(inner, is_never)?;
                return self.not(inner);
            }
            Guard::And(terms) => {
                let mut all = Formula::ALWAYS;
                for term in terms {
                    let term = self.guard(term, is_never)?;
                    all = self.and(all, term)?;
                }
                return Ok(all);
            }
            Guard::Or(terms) => {
                let mut any = Formula::NEVER;
                for term in terms {
                    let term = self.guard(term, is_never)?;
                    any = self.or(any, term)?;
                }
                return Ok(any);
            }
            Guard::Exit => Atom::Exit,
            Guard::Timeout => Atom::Timeout,
            Guard::Busy => Atom::Busy,
            Guard::Own(flag) => Atom::Own(*flag),
            Guard::Parent(flag) => Atom::Parent(*flag),
        };
        self.atom(atom, is_never)
    }

    /// The diagram of one flag.
    ///
    /// # Errors
    /// There are too many flags, or no steps are left.
    pub fn atom(
        &mut self,
        atom: Atom,
        is_never: &impl Fn(Atom) -> bool,
    ) -> Result<Formula, TooLarge> {
        if is_never(atom) {
            return Ok(Formula::NEVER);
        }
        let place = match self.order.get(&atom) {
            Some(&place) => place,
            None if self.atoms.len() == MAX_ATOMS => return Err(TooLarge),
            None => {
                let place = self.atoms.len() as u32;
                self.atoms.push(atom);
                self.order.insert(atom, place);
                place
            }
        };
        self.node(place, Formula::NEVER, Formula::ALWAYS)
    }

    /// True where both are.
    ///
    /// # Errors
    /// No steps are left.
    pub fn and(&mut self, a: Formula, b: Formula) -> Result<Formula, TooLarge> {
        self.choose(a, b, Formula::NEVER)
    }

    /// True where one or both are.
    ///
    /// # Errors
    /// No steps are left.
    pub fn or(&mut self, a: Formula, b: Formula) -> Result<Formula, TooLarge> {
        self.choose(a, Formula::ALWAYS, b)
    }

    /// True where it is not.
    ///
    /// # Errors
    /// No steps are left.
    pub fn not(&mut self, a: Formula) -> Result<Formula, TooLarge> {
        self.choose(a, Formula::NEVER, Formula::ALWAYS)
    }

    /// `if_so` where `condition` is true, `if_not` elsewhere. The depth of the recursion is at most
    /// the number of flags.
    fn choose(
        &mut self,
        condition: Formula,
        if_so: Formula,
        if_not: Formula,
    ) -> Result<Formula, TooLarge> {
        if condition == Formula::ALWAYS || if_so == if_not {
            return Ok(if_so);
        }
        if condition == Formula::NEVER {
            return Ok(if_not);
        }
        if (if_so, if_not) == (Formula::ALWAYS, Formula::NEVER) {
            return Ok(condition);
        }
        // Also for an answer that is known: whoever asks often is to come to an end.
        self.step()?;
        let question = (condition, if_so, if_not);
        if let Some(&known) = self.chosen.get(&question) {
            return Ok(known);
        }
        let parts = [condition, if_so, if_not];
        let Some(atom) = parts
            .into_iter()
            .filter_map(|part| Some(self.look(part)?.atom))
            .min()
        else {
            // Three ends: the cases above.
            return Ok(if_not);
        };
        let with = |holds: bool, diagrams: &mut Self| {
            let [condition, if_so, if_not] = parts.map(|part| diagrams.assume(part, atom, holds));
            diagrams.choose(condition, if_so, if_not)
        };
        let if_not = with(false, self)?;
        let if_so = with(true, self)?;
        let result = self.node(atom, if_not, if_so)?;
        self.chosen.insert(question, result);
        Ok(result)
    }

    fn look(&self, formula: Formula) -> Option<Node> {
        self.nodes
            .get((formula.0 as usize).checked_sub(2)?)
            .copied()
    }

    /// What is left of a formula whose first flag is not before `atom`, once that is known.
    fn assume(&self, formula: Formula, atom: u32, holds: bool) -> Formula {
        match self.look(formula) {
            Some(node) if node.atom == atom && holds => node.if_so,
            Some(node) if node.atom == atom => node.if_not,
            _ => formula,
        }
    }

    fn node(&mut self, atom: u32, if_not: Formula, if_so: Formula) -> Result<Formula, TooLarge> {
        if if_not == if_so {
            return Ok(if_so);
        }
        let node = Node {
            atom,
            if_not,
            if_so,
        };
        if let Some(&known) = self.known.get(&node) {
            return Ok(known);
        }
        self.step()?;
        self.nodes.push(node);
        let formula = Formula(self.nodes.len() as u32 + 1);
        self.known.insert(node, formula);
        Ok(formula)
    }

    /// A choice of flags that makes a formula true, with few flags set: each flag that matters, and
    /// whether it is set. All other flags can be as they like. `None` if it is never true.
    pub fn example(&self, formula: Formula) -> Option<Vec<(Atom, bool)>> {
        let mut example = Vec::new();
        let mut here = formula;
        while let Some(node) = self.look(here) {
            let is_set = !node.if_not.can_be_true();
            let atom = self.atoms.get(node.atom as usize)?;
            example.push((*atom, is_set));
            here = if is_set { node.if_so } else { node.if_not };
        }
        here.can_be_true().then_some(example)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn guard() -> impl Strategy<Value = Guard> {
        let atom = prop_oneof![
            Just(Guard::Exit),
            Just(Guard::Timeout),
            Just(Guard::Busy),
            (0..3_usize).prop_map(Guard::Own),
            (0..2_usize).prop_map(Guard::Parent),
        ];
        atom.prop_recursive(5, 40, 4, |inner| {
            prop_oneof![
                inner.clone().prop_map(|inner| Guard::Not(Box::new(inner))),
                prop::collection::vec(inner.clone(), 2..5).prop_map(Guard::And),
                prop::collection::vec(inner, 2..5).prop_map(Guard::Or),
            ]
        })
    }

    /// What a guard says of a choice of the eight atoms above, as bits.
    fn says(guard: &Guard, choice: u32) -> bool {
        let bit = |place: usize| choice >> place & 1 == 1;
        match guard {
            Guard::Exit => bit(0),
            Guard::Timeout => bit(1),
            Guard::Busy => bit(2),
            Guard::Own(flag) => bit(3 + flag),
            Guard::Parent(flag) => bit(6 + flag),
            Guard::Not(inner) => !says(inner, choice),
            Guard::And(terms) => terms.iter().all(|term| says(term, choice)),
            Guard::Or(terms) => terms.iter().any(|term| says(term, choice)),
        }
    }

    fn place(atom: Atom) -> usize {
        match atom {
            Atom::Exit => 0,
            Atom::Timeout => 1,
            Atom::Busy => 2,
            Atom::Own(flag) => 3 + flag,
            Atom::Parent(flag) => 6 + flag,
        }
    }

    proptest! {
        #[test]
        fn a_formula_can_be_true_where_its_guard_can(first in guard(), second in guard(), never in 0..8_usize) {
            let mut diagrams = Diagrams::default();
            diagrams.restart(100_000);
            let is_never = |atom| place(atom) == never;
            let a = diagrams.guard(&first, &is_never).unwrap();
            let b = diagrams.guard(&second, &is_never).unwrap();
            let not_a = diagrams.not(a).unwrap();
            let both = diagrams.and(a, b).unwrap();
            let after = diagrams.and(not_a, b).unwrap();
            let either = diagrams.or(a, b).unwrap();
            let choices = || (0..256_u32).filter(|choice| choice >> never & 1 == 0);
            prop_assert_eq!(a.can_be_true(), choices().any(|it| says(&first, it)));
            prop_assert_eq!(both.can_be_true(), choices().any(|it| says(&first, it) && says(&second, it)));
            prop_assert_eq!(after.can_be_true(), choices().any(|it| !says(&first, it) && says(&second, it)));
            prop_assert_eq!(either == Formula::ALWAYS, choices().all(|it| says(&first, it) || says(&second, it)));
            match diagrams.example(both) {
                None => prop_assert!(!both.can_be_true()),
                Some(example) => {
                    let set = example.iter().filter(|(_, is_set)| *is_set);
                    let choice = set.fold(0, |choice, (atom, _)| choice | 1 << place(*atom));
                    prop_assert!(says(&first, choice) && says(&second, choice));
                }
            }
        }
    }

    #[test]
    fn what_is_too_large_is_told() {
        let mut diagrams = Diagrams::default();
        let flags = |count: usize| Guard::Or((0..count).map(Guard::Own).collect());
        diagrams.restart(1_000_000);
        assert!(diagrams.guard(&flags(MAX_ATOMS), &|_| false).is_ok());
        diagrams.restart(1_000_000);
        assert_eq!(
            diagrams.guard(&flags(MAX_ATOMS + 1), &|_| false),
            Err(TooLarge)
        );
        // (a0 and b0) or (a1 and b1) or …, with all a before all b, is exponential in this order.
        let pairs = (0..60).map(|pair| Guard::And(vec![Guard::Own(pair), Guard::Own(60 + pair)]));
        let hard = Guard::And(vec![flags(120), Guard::Or(pairs.collect())]);
        diagrams.restart(10_000);
        assert_eq!(diagrams.guard(&hard, &|_| false), Err(TooLarge));
        assert_eq!(diagrams.steps(), 10_000);
    }
}
