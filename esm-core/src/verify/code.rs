//! Code: the tests of guards, masks, and rows of actions.

use core::ops::{Range, RangeInclusive};

use super::finding::{Entry, Finding, entry};
use crate::format::{self, Section};
use crate::layout::{Code, Mask};
use crate::refusal::Cause;
use crate::tables::Tables;

/// The table of code, and how far the check has come in it. Guards and actions have their records one behind the other.
pub(super) struct Programs<'a> {
    instructions: &'a [Code],
    /// The same records as masks, which some are.
    masks: &'a [Mask],
    /// Records that were checked.
    pub(super) checked: usize,
}

/// What the instructions of a guard or an action can do and name.
pub(super) struct Scope {
    pub(super) operations: RangeInclusive<u16>,
    /// Flags at the head of the instance's block.
    pub(super) head: Range<usize>,
    /// Flags of the state that is left, or entered.
    pub(super) own: Range<usize>,
    /// Channels of the instance.
    pub(super) channels: usize,
}

impl<'a> Programs<'a> {
    pub(super) fn of(tables: &Tables<'a>) -> Self {
        Self {
            instructions: tables.records(),
            masks: tables.records(),
            checked: 0,
        }
    }

    /// Checks the tests of a guard, up to their end. No jump leads past it.
    pub(super) fn check_tests(&mut self, first: u16, scope: &Scope) -> Result<(), Finding> {
        self.begin(first)?;
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
        self.begin(first)?;
        while self.check_instruction(scope, Cause::Index)?.low() == 0 {}
        Ok(())
    }

    /// Checks a mask: it has two bits at least, of a window of so many flags, and its value has no others.
    pub(super) fn check_mask(&mut self, first: u16, window: usize) -> Result<(), Finding> {
        self.begin(first)?;
        let record = entry(self.masks, self.checked, Cause::Index)?;
        self.checked += 1;
        let (mask, value) = (record.mask.get(), record.value.get());
        let is_right = mask >> window == 0 && value & !mask == 0 && mask.count_ones() >= 2;
        record.ensure(is_right, Cause::Index)
    }

    /// Ensures that the next record is the first of a guard or an action.
    fn begin(&self, first: u16) -> Result<(), Finding> {
        if usize::from(first) == self.checked {
            Ok(())
        } else {
            Err(Finding::new(Section::Code, self.checked, Cause::Order))
        }
    }

    /// Checks the next instruction. Where there is none, its absence has this cause.
    fn check_instruction(
        &mut self,
        scope: &Scope,
        absent: Cause,
    ) -> Result<Entry<'a, Code>, Finding> {
        let code = entry(self.instructions, self.checked, absent)?;
        self.checked += 1;
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
