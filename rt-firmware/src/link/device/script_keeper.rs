//! The steps of a script that have arrived, as they are kept in flash.

use super::port::LinkPort;
use crate::store::{SCRIPT_BYTES, SCRIPT_HEAD_BYTES, SCRIPT_STEP_BYTES};
use esm_link::behaviours::{
    BehaviourRequest, Call, MAX_CALL_PARAMS, MAX_SCRIPT_STEPS, MAX_WATCHES, PARAM_BYTES,
    WATCH_BYTES,
};
use esm_link::message::LinkError;

/// The first byte of a script: what follows is laid out like this.
const FORMAT: u8 = 1;

/// Offsets in a step.
const PARAMS_AT: usize = 8;
const WATCHES_AT: usize = PARAMS_AT + MAX_CALL_PARAMS * PARAM_BYTES;
const COUNTS_AT: usize = WATCHES_AT + MAX_WATCHES * WATCH_BYTES;

/// What is said of a script before its steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Head {
    pub(super) script: u32,
    pub(super) steps: u8,
    pub(super) all: u8,
    /// Hash of the mission with which the robot starts it.
    pub(super) mission: u32,
}

impl Head {
    fn to_bytes(self) -> [u8; SCRIPT_HEAD_BYTES] {
        let [m0, m1, m2, m3] = self.mission.to_le_bytes();
        let [s0, s1, s2, s3] = self.script.to_le_bytes();
        let (steps, all) = (self.steps, self.all);
        [FORMAT, steps, all, 0, m0, m1, m2, m3, s0, s1, s2, s3]
    }

    fn of_bytes(bytes: [u8; SCRIPT_HEAD_BYTES]) -> Option<Self> {
        let [FORMAT, steps, all, _, m0, m1, m2, m3, s0, s1, s2, s3] = bytes else {
            return None;
        };
        Some(Self {
            script: u32::from_le_bytes([s0, s1, s2, s3]),
            steps,
            all,
            mission: u32::from_le_bytes([m0, m1, m2, m3]),
        })
    }

    /// Bytes of the whole script.
    fn len(self) -> usize {
        SCRIPT_HEAD_BYTES + usize::from(self.all) * SCRIPT_STEP_BYTES
    }
}

/// How far the robot is with running the script by itself.
#[derive(Clone, Copy, Debug)]
pub(super) struct StartUp {
    /// The step that is to be put away next; behind the last one, it is to begin.
    pub(super) next: u8,
    /// Until then it is tried, and not before: on the board's clock.
    pub(super) until_us: u64,
    pub(super) again_us: u64,
    /// The real-time side was asked.
    pub(super) is_asked: bool,
}

/// The steps that have arrived last, and what the flash has.
pub(crate) struct ScriptKeeper {
    /// As it is kept: its head, and its steps.
    bytes: [u8; SCRIPT_BYTES],
    script: u32,
    /// Bit n: step n is there.
    there: u16,
    /// What was to run last: which script, its steps, and all of them.
    pub(super) run: (u32, u8, u8),
    pub(super) kept: Option<Head>,
    pub(super) start_up: Option<StartUp>,
}

impl ScriptKeeper {
    /// Nothing has arrived, and nothing is known of the flash.
    pub(crate) const EMPTY: Self = Self {
        bytes: [0; SCRIPT_BYTES],
        script: 0,
        there: 0,
        run: (0, 0, 0),
        kept: None,
        start_up: None,
    };

    /// Whether the real-time side was asked for the kept script.
    pub(super) fn is_asked(&self) -> bool {
        self.start_up.is_some_and(|start_up| start_up.is_asked)
    }

    /// Notes what a client asks for, which comes before what the robot runs by itself.
    pub(super) fn note(&mut self, request: &BehaviourRequest<'_>) {
        match *request {
            BehaviourRequest::Step {
                script,
                index,
                ref call,
            } => {
                self.start_up = None;
                if script != self.script {
                    (self.script, self.there) = (script, 0);
                }
                self.there &= !1_u16.checked_shl(index.into()).unwrap_or(0);
                if let Some(place) = self.step_mut(index)
                    && put_step(place, call).is_some()
                {
                    self.there |= 1 << index;
                }
            }
            BehaviourRequest::Run { script, steps, all } => {
                self.start_up = None;
                self.run = (script, steps, all);
            }
            BehaviourRequest::EndScript => self.start_up = None,
            _ => {}
        }
    }

    fn step_mut(&mut self, index: u8) -> Option<&mut [u8; SCRIPT_STEP_BYTES]> {
        let steps = self.bytes.get_mut(SCRIPT_HEAD_BYTES..)?;
        let (steps, _) = steps.as_chunks_mut::<SCRIPT_STEP_BYTES>();
        steps.get_mut(usize::from(index))
    }

    /// The bytes that are to be kept of the script that has arrived.
    pub(super) fn whole(&mut self, head: Head) -> Result<&[u8], LinkError> {
        let all = usize::from(head.all);
        if head.steps == 0 || head.steps > head.all || all > MAX_SCRIPT_STEPS {
            return Err(LinkError::NoScript);
        }
        let needed = u32::from(self.there) | !0 << all;
        if head.script != self.script || needed != !0 {
            return Err(LinkError::NoScript);
        }
        if let Some(place) = self.bytes.first_chunk_mut() {
            *place = head.to_bytes();
        }
        self.bytes.get(..head.len()).ok_or(LinkError::NoScript)
    }

    /// Reads what the flash has.
    pub(super) fn load(&mut self, port: &mut impl LinkPort) {
        let Some(mission_store) = port.mission_store() else {
            return;
        };
        let len = mission_store.kept_script(&mut self.bytes);
        let head = self.bytes.first_chunk().copied().and_then(Head::of_bytes);
        self.kept = head.filter(|head| {
            len == head.len() && (1..=head.all).contains(&head.steps) && len <= SCRIPT_BYTES
        });
        if let Some(head) = self.kept {
            (self.script, self.there) = (head.script, !0);
        }
    }

    /// A step that has arrived.
    pub(super) fn step(&self, index: u8) -> Option<Call<'_>> {
        let at = SCRIPT_HEAD_BYTES + usize::from(index) * SCRIPT_STEP_BYTES;
        call_of(self.bytes.get(at..)?.first_chunk()?)
    }
}

/// Writes a step down. None where it has more than there can be.
fn put_step(place: &mut [u8; SCRIPT_STEP_BYTES], call: &Call<'_>) -> Option<()> {
    place.fill(0);
    place
        .first_chunk_mut()
        .map(|task| *task = call.task.to_le_bytes())?;
    let params = place.get_mut(PARAMS_AT..WATCHES_AT)?;
    params
        .get_mut(..call.params.len())?
        .copy_from_slice(call.params);
    let watches = place.get_mut(WATCHES_AT..COUNTS_AT)?;
    watches
        .get_mut(..call.watches.len())?
        .copy_from_slice(call.watches);
    let counts = place.get_mut(COUNTS_AT..)?;
    counts.copy_from_slice(&[call.params.len() as u8, call.watches.len() as u8]);
    Some(())
}

/// A step as a client would send it.
fn call_of(step: &[u8; SCRIPT_STEP_BYTES]) -> Option<Call<'_>> {
    let &[params, watches] = step.get(COUNTS_AT..)?.first_chunk()?;
    Some(Call {
        task: u64::from_le_bytes(*step.first_chunk()?),
        params: step.get(PARAMS_AT..WATCHES_AT)?.get(..params.into())?,
        watches: step.get(WATCHES_AT..COUNTS_AT)?.get(..watches.into())?,
    })
}
