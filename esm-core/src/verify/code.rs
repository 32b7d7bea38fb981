//! Code: the tests of guards, masks, and rows of actions.

use core::ops::Range;

use super::finding::{Entry, Finding};
use super::pass::Pass;
use crate::format::{self, Section};
use crate::layout::{Code, Mask};
use crate::refusal::Cause;

/// What the instructions of a guard or an action can do and name.
pub(super) struct Scope {
    pub(super) operations: Range<u16>,
    /// Flags at the head of the instance's block.
    pub(super) head: Range<usize>,
    /// Flags of the state that is left, or entered.
    pub(super) own: Range<usize>,
    /// Channels of the instance.
    pub(super) channels: usize,
}

/// Guards and actions have their records one behind the other.
impl<'a> Pass<'a> {
    /// Checks the tests of a guard, up to their end. No jump leads past it.
    pub(super) fn check_tests(&mut self, first: u16, scope: &Scope) -> Result<(), Finding> {
        self.begin_code(first)?;
        let mut farthest = 0;
        loop {
            let code = self.check_instruction(scope, Cause::Kind)?;
            if code.operation() == format::CODE_END {
                return code.ensure(farthest <= code.index, Cause::Direction);
            }
            farthest = farthest.max(code.index + code.low());
        }
    }

    /// Checks a row of actions, up to the last.
    pub(super) fn check_row(&mut self, first: u16, scope: &Scope) -> Result<(), Finding> {
        self.begin_code(first)?;
        while self.check_instruction(scope, Cause::Index)?.low() == 0 {}
        Ok(())
    }

    /// Checks a mask: it has two bits at least, of a window of so many flags, and its value has no
    /// others.
    pub(super) fn check_mask(&mut self, first: u16, window: usize) -> Result<(), Finding> {
        self.begin_code(first)?;
        let record = self.next::<Mask>(Cause::Index)?;
        let (mask, value) = (record.mask.get(), record.value.get());
        let has_two_bits = mask & mask.wrapping_sub(1) != 0;
        let is_right = has_two_bits && mask >> window == 0 && value & !mask == 0;
        record.ensure(is_right, Cause::Index)
    }

    /// Ensures that the next record is the first of a guard or an action.
    fn begin_code(&self, first: u16) -> Result<(), Finding> {
        let next = self.checked[Section::Code];
        if usize::from(first) == next {
            Ok(())
        } else {
            Err(Finding::new(Section::Code, next, Cause::Order))
        }
    }

    /// Checks the next instruction. Where there is none, its absence has this cause.
    fn check_instruction(
        &mut self,
        scope: &Scope,
        absent: Cause,
    ) -> Result<Entry<'a, Code>, Finding> {
        let code = self.next::<Code>(absent)?;
        let (operation, operand) = (code.operation(), code.operand.get());
        code.ensure(scope.operations.contains(&operation), Cause::Kind)?;
        let exists = if operation == format::CODE_SEND {
            operand < scope.channels
        } else if operand < scope.head.end {
            operand >= scope.head.start
        } else {
            scope.own.contains(&operand)
        };
        code.ensure(exists, Cause::Index)?;
        Ok(code)
    }
}
