//! What a processor can know of its partner at the other end of a link, from the numbers of the
//! frames that have arrived, its own clock and the declarations alone: how many are missing, how
//! old values are, and by how much the partner's clock gains.
//!
//! A frame of number *n* starts *n* periods of the partner's clock after that of number 0. Most of
//! them arrive as long after their start as the medium takes; some later, none earlier. So a
//! straight line through the arrivals has the partner's period for its slope, and the earliest of
//! them, against it, is when a frame arrives that had nothing to wait for.

use esm_core::frames::LATE_PERIODS;
use esm_link::frames::configuration::Configuration;
use esm_link::frames::occurrences::Occurrences;
use esm_link::frames::receiver::{InFrame, InFrames, ReceiveError};
use esm_link::frames::wire::OVERHEAD_BYTES;

use super::arrivals::{Arrival, Arrivals, Came};
use super::declaration::{Link, Medium};
use crate::host_run::WiredLink;
use crate::inspect::FrameRow;
use crate::medium::can;
use crate::pictures::MissionStates;

/// Microseconds in a second.
const US_IN_S: f64 = 1e6;
/// Millionths.
const PPM: f64 = 1e6;
/// A partner's clock is judged by no less than this, in microseconds and in frames.
const LEAST_TIME_US: f64 = 1e6;
const LEAST_FRAMES: usize = 8;
/// By how much a frame may come earlier or later than the one before says, in microseconds, and for
/// each microsecond between both. Where it is more, its sender has other times than before.
const MOST_SHIFT_US: u64 = 1_000;
const MOST_DRIFT: u64 = 1_000;

/// What a frame crosses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Way {
    medium: Medium,
    bit_us: f64,
    byte_bits: u8,
    delay_us: f64,
}

impl Way {
    /// The medium of a link that is declared like this.
    #[must_use]
    pub fn new(link: &Link, declared: &WiredLink) -> Self {
        Way {
            medium: link.medium,
            bit_us: US_IN_S / f64::from(declared.rate_bps.max(1)),
            byte_bits: declared.bits,
            delay_us: link.delay_us as f64,
        }
    }

    /// How long a frame takes from its start to its arrival at least, in microseconds.
    fn least_us(&self, payload_bytes: usize) -> f64 {
        let bits = match self.medium {
            Medium::Line => {
                let bytes = (payload_bytes + OVERHEAD_BYTES) as f64;
                bytes * f64::from(self.byte_bits)
            }
            Medium::Memory => 0.0,
            Medium::Can => can::least_bits(payload_bytes as u64) as f64,
        };
        bits * self.bit_us + self.delay_us
    }
}

/// A mission that ran, as one end of a link sees it.
#[derive(Clone, Debug)]
pub struct Ran<'m> {
    /// Robot time of its first macro step, in microseconds.
    start_us: u64,
    /// What it receives. None where it has no such link, or does not use it.
    link: Option<&'m WiredLink>,
    /// When one of its states received, without a break.
    listened_us: Vec<(u64, u64)>,
    /// Whether it has gone on with what was before.
    is_warm: bool,
}

impl<'m> Ran<'m> {
    /// A mission with this link, and the states in which it was. One that is warm has gone on with
    /// what the mission before was at.
    #[must_use]
    pub fn new(link: Option<&'m WiredLink>, states: &MissionStates, is_warm: bool) -> Self {
        let receives = |path: &str, name: &str| {
            let mut of_link = link.iter().flat_map(|link| &link.receive_states);
            of_link.any(|(of_path, of_name)| of_path == path && of_name == name)
        };
        let mut spans: Vec<(u64, u64)> = (states.regions.iter())
            .flat_map(|region| region.spans.iter().map(|span| (&region.path, span)))
            .filter(|(path, span)| receives(path, &span.state))
            .map(|(_, span)| (span.start_us, span.end_us))
            .collect();
        spans.sort_unstable();
        let mut listened_us: Vec<(u64, u64)> = Vec::new();
        for (from_us, to_us) in spans {
            match listened_us.last_mut() {
                // One state receives after another: nothing is lost.
                Some(last) if last.1 >= from_us => last.1 = last.1.max(to_us),
                _ => listened_us.push((from_us, to_us)),
            }
        }
        Ran {
            start_us: states.start_us,
            link,
            listened_us,
            is_warm,
        }
    }

    fn frames(&self) -> impl Iterator<Item = &'m FrameRow> {
        let link = self.link.into_iter();
        link.flat_map(|link| link.frames.iter().filter(|frame| frame.direction == "in"))
    }
}

/// The frames that a mission receives.
struct Received<'m>(Vec<(&'m FrameRow, Configuration)>);

/// What a frame is known by.
#[must_use]
pub fn configuration_of(frame: &FrameRow) -> Option<Configuration> {
    let hash = u64::from_str_radix(&frame.configuration, 16).ok()?;
    Some(Configuration::from_hash(hash))
}

impl<'m> Received<'m> {
    fn of(mission: &Ran<'m>) -> Self {
        let with_hash = |frame: &'m FrameRow| Some((frame, configuration_of(frame)?));
        Received(mission.frames().filter_map(with_hash).collect())
    }
}

impl InFrames for Received<'_> {
    fn find(&self, identifier: u16) -> Option<(usize, InFrame)> {
        let index = self
            .0
            .iter()
            .position(|(frame, _)| frame.id == identifier)?;
        let (frame, configuration) = self.0.get(index)?;
        let frame = InFrame {
            identifier,
            payload_bytes: u8::try_from(frame.payload_bytes).ok()?,
            configuration: *configuration,
        };
        Some((index, frame))
    }
}

/// What is known of a partner.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Partner {
    /// By how much its clock gains on the processor's own, in millionths. None where too little has
    /// arrived to say it.
    pub drift_ppm: Option<f64>,
    /// What came with a wrong checksum or length.
    pub corrupt: u64,
    /// Frames that are declared in another way at the other end.
    pub other_configuration: u64,
    /// Frames that nobody here receives.
    pub unknown: u64,
    /// How often the numbers of a frame began anew or leapt, or came at other times than before.
    pub begun_anew: u64,
    /// Of each frame that some mission receives.
    pub frames: Vec<FrameAccount>,
}

/// What is known of a frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameAccount {
    /// Its name.
    pub frame: String,
    /// Its identifier.
    pub id: u16,
    /// Its period, in microseconds.
    pub period_us: u32,
    /// Occurrences that were taken.
    pub received: u64,
    /// Numbers that were left out between them.
    pub lost: u64,
    /// Numbers that came again.
    pub doubled: u64,
    /// Occurrences that came while no state received.
    pub dropped: u64,
    /// How often none was taken for longer than its `late`.
    pub late: u64,
    /// How old the last value is at the end of the run, or where a mission takes over that does not
    /// receive it, from the start of its frame, in microseconds.
    pub age_us: Option<f64>,
    /// How old any was that was there, at most.
    pub largest_age_us: Option<f64>,
}

/// An occurrence that was taken.
#[derive(Clone, Copy, Debug)]
pub struct Point {
    /// Its number since the first that follow each other without a leap.
    number: u64,
    /// As it came.
    low: u8,
    at_us: u64,
    taken_us: u64,
}

impl Point {
    /// The first of those that follow each other.
    pub(crate) fn first(at_us: u64, low: u8) -> Self {
        Point {
            number: 0,
            low,
            at_us,
            taken_us: at_us,
        }
    }

    /// The next occurrence, if it comes when that is expected, give or take some time.
    pub(crate) fn next(&self, period_us: u64, most_us: u64, at_us: u64, low: u8) -> Option<Self> {
        let passed_us = at_us.checked_sub(self.at_us)?;
        let periods = (passed_us + period_us / 2) / period_us;
        let expected = self.low.wrapping_add(periods as u8);
        let beside = i64::from(low.wrapping_sub(expected) as i8);
        if beside.abs() > 1 {
            return None;
        }
        let number = (self.number + periods).checked_add_signed(beside)?;
        let expected_us = (number.checked_sub(self.number)?).checked_mul(period_us)?;
        let shift_us = passed_us.abs_diff(expected_us);
        let is_in_time = shift_us <= most_us + passed_us / MOST_DRIFT;
        (number > self.number && is_in_time).then_some(Point {
            number,
            ..Point::first(at_us, low)
        })
    }
}

/// Occurrences whose numbers follow each other as the time between them says.
type Stretch = Vec<Point>;

/// A frame while its arrivals are looked at.
struct Followed<'m> {
    frame: &'m FrameRow,
    account: FrameAccount,
    occurrences: Occurrences,
    stretches: Vec<Stretch>,
    /// From when on its lateness is counted.
    waited_from_us: u64,
    /// When a mission took over that does not receive it.
    left_us: Option<u64>,
}

/// A straight line through the arrivals of a stretch.
pub(crate) struct Course {
    number: u64,
    at_us: u64,
    /// When a frame of that number starts, from the time above.
    start_us: f64,
    period_us: f64,
}

impl Course {
    /// Of these arrivals, of which the quickest took a time from its start.
    pub(crate) fn of(stretch: &[Point], period_us: f64, least_us: f64) -> Option<Self> {
        let first = stretch.first()?;
        let places = stretch.iter().map(|point| {
            let number = (point.number - first.number) as f64;
            (number, (point.at_us - first.at_us) as f64)
        });
        let period_us = match has_enough(stretch, period_us) {
            true => slope(places.clone()).unwrap_or(period_us),
            false => period_us,
        };
        let against = places.map(|(number, at_us)| at_us - number * period_us);
        let earliest_us = against.reduce(f64::min)?;
        Some(Course {
            number: first.number,
            at_us: first.at_us,
            start_us: earliest_us - least_us,
            period_us,
        })
    }

    /// How old the value of an occurrence is at a time.
    pub(crate) fn age_us(&self, point: &Point, now_us: u64) -> f64 {
        let number = (point.number - self.number) as f64;
        let start_us = self.start_us + number * self.period_us;
        (now_us as f64 - self.at_us as f64) - start_us
    }
}

/// Whether a partner's clock can be judged by a stretch.
fn has_enough(stretch: &[Point], period_us: f64) -> bool {
    let (Some(first), Some(last)) = (stretch.first(), stretch.last()) else {
        return false;
    };
    let time_us = (last.number - first.number) as f64 * period_us;
    stretch.len() >= LEAST_FRAMES && time_us >= LEAST_TIME_US
}

/// The slope of the line from which all places together are least away.
fn slope(places: impl Iterator<Item = (f64, f64)> + Clone) -> Option<f64> {
    let (mut count, mut sum_x, mut sum_y) = (0.0, 0.0, 0.0);
    for (x, y) in places.clone() {
        count += 1.0;
        sum_x += x;
        sum_y += y;
    }
    let (mean_x, mean_y) = (sum_x / count, sum_y / count);
    let (mut across, mut along) = (0.0, 0.0);
    for (x, y) in places {
        across += (x - mean_x) * (y - mean_y);
        along += (x - mean_x) * (x - mean_x);
    }
    (along > 0.0).then(|| across / along)
}

impl<'m> Followed<'m> {
    fn new(frame: &'m FrameRow) -> Self {
        Followed {
            frame,
            account: FrameAccount {
                frame: frame.frame.clone(),
                id: frame.id,
                period_us: frame.period_us,
                ..FrameAccount::default()
            },
            occurrences: Occurrences::new(),
            stretches: Vec::new(),
            waited_from_us: 0,
            left_us: None,
        }
    }

    fn period_us(&self) -> u64 {
        u64::from(self.frame.period_us.max(1))
    }

    fn late_us(&self) -> u64 {
        let late_us = self.frame.late_us.map(u64::from);
        late_us.unwrap_or(LATE_PERIODS * self.period_us())
    }

    /// Counts if none was taken for too long up to an activation.
    fn wait_until(&mut self, looked_us: Option<u64>) {
        let is_late = |us: u64| us.saturating_sub(self.waited_from_us) > self.late_us();
        self.account.late += u64::from(looked_us.is_some_and(is_late));
    }

    fn take(&mut self, arrival: &Arrival, low: u8) {
        let waited_us = arrival.taken_us.saturating_sub(self.waited_from_us);
        let missing = self.occurrences.missing();
        if !(self.occurrences).take(low, waited_us > self.late_us()) {
            self.account.doubled += 1;
            return;
        }
        self.account.lost += u64::from(self.occurrences.missing() - missing);
        self.account.received += 1;
        self.wait_until(arrival.before_us);
        self.waited_from_us = arrival.taken_us;
        let first = Point {
            taken_us: arrival.taken_us,
            ..Point::first(arrival.at_us, low)
        };
        let last = self.stretches.last().and_then(|it| it.last());
        let (period_us, taken_us) = (self.period_us(), arrival.taken_us);
        let next = last.and_then(|it| it.next(period_us, MOST_SHIFT_US, arrival.at_us, low));
        match (next, self.stretches.last_mut()) {
            (Some(next), Some(stretch)) => stretch.push(Point { taken_us, ..next }),
            _ => self.stretches.push(vec![first]),
        }
    }

    /// The ages of all values, up to the end of the run.
    fn ages(&mut self, way: &Way, end_us: u64) {
        let end_us = self.left_us.unwrap_or(end_us);
        let period_us = self.period_us() as f64;
        let least_us = way.least_us(self.frame.payload_bytes);
        let mut largest_us: Option<f64> = None;
        let mut stretches = self.stretches.iter().peekable();
        while let Some(stretch) = stretches.next() {
            let Some(course) = Course::of(stretch, period_us, least_us) else {
                continue;
            };
            let behind = stretches.peek().and_then(|next| next.first());
            let replaced = stretch.iter().skip(1).chain(behind);
            let replaced = replaced.map(|next| next.taken_us);
            for (point, until_us) in stretch.iter().zip(replaced.chain([end_us])) {
                let age_us = course.age_us(point, until_us);
                largest_us = Some(largest_us.map_or(age_us, |it| it.max(age_us)));
                self.account.age_us = Some(age_us);
            }
        }
        self.account.largest_age_us = largest_us;
    }

    /// The longest stretch by which the partner's clock can be judged: how long it is, and the
    /// drift in millionths.
    fn drift_ppm(&self) -> Option<(usize, f64)> {
        let period_us = self.period_us() as f64;
        let enough = self.stretches.iter().filter(|it| has_enough(it, period_us));
        let longest = enough.max_by_key(|it| it.len())?;
        let course = Course::of(longest, period_us, 0.0)?;
        Some((longest.len(), (period_us / course.period_us - 1.0) * PPM))
    }
}

/// What a processor knows of its partner, from all that has arrived while these missions ran, one
/// after the other. The run ended at a time of its clock.
#[must_use]
pub fn known(arrivals: &Arrivals, missions: &[Ran<'_>], way: &Way, end_us: u64) -> Partner {
    let mut partner = Partner::default();
    let mut followed: Vec<Followed<'_>> = Vec::new();
    let mut rest = &arrivals.all[..];
    for (index, mission) in missions.iter().enumerate() {
        let next = missions.get(index + 1);
        let ends_us = next.map_or(u64::MAX, |next| next.start_us);
        let (own, others) = rest.split_at(rest.partition_point(|it| it.taken_us < ends_us));
        rest = others;
        let frames = Received::of(mission);
        let before = index.checked_sub(1).and_then(|before| missions.get(before));
        let is_same = before.is_some_and(|before| before.link == mission.link);
        if !is_same {
            for known in &mut followed {
                known.occurrences = Occurrences::new();
            }
        }
        let mut places = Vec::new();
        for (frame, _) in &frames.0 {
            let is_it = |known: &Followed<'_>| known.frame.configuration == frame.configuration;
            let place = followed.iter().position(is_it);
            places.push(place.unwrap_or_else(|| {
                followed.push(Followed::new(frame));
                followed.len() - 1
            }));
        }
        for (place, known) in followed.iter_mut().enumerate() {
            known.left_us = match places.contains(&place) {
                true => None,
                false => known.left_us.or(Some(mission.start_us)),
            };
        }
        let mut own = own.iter().peekable();
        for (nth, (from_us, to_us)) in mission.listened_us.iter().enumerate() {
            // A link that goes on has been listened to before.
            let goes_on = nth == 0 && is_same && mission.is_warm && *from_us == mission.start_us;
            for place in places.iter().filter(|_| !goes_on) {
                if let Some(known) = followed.get_mut(*place) {
                    known.waited_from_us = *from_us;
                }
            }
            let listens_next_us = mission.listened_us.get(nth + 1).map(|it| it.0);
            let is_own = |it: &&Arrival| listens_next_us.is_none_or(|next| it.taken_us < next);
            while let Some(arrival) = own.next_if(is_own) {
                let is_dropped = arrival.at_us <= *from_us && !goes_on;
                match arrival.came.read(&frames) {
                    Came::Frame { identifier, number } => {
                        let index = frames.find(identifier).map(|(index, _)| index);
                        let place = index.and_then(|index| places.get(index));
                        let Some(known) = place.and_then(|it| followed.get_mut(*it)) else {
                            continue;
                        };
                        match is_dropped {
                            true => known.account.dropped += 1,
                            false => known.take(arrival, number),
                        }
                    }
                    // What nobody listens to is no error.
                    Came::Wrong(_) | Came::Wire(_) if is_dropped => {}
                    Came::Wrong(ReceiveError::Configuration) => partner.other_configuration += 1,
                    Came::Wrong(ReceiveError::UnknownIdentifier) => partner.unknown += 1,
                    Came::Wrong(_) | Came::Wire(_) => partner.corrupt += 1,
                }
            }
            let is_last = index + 1 == missions.len() && listens_next_us.is_none();
            let looked_us = match arrivals.looked_us.filter(|_| is_last) {
                Some(looked_us) => looked_us.min(*to_us),
                None => *to_us,
            };
            for place in &places {
                if let Some(known) = followed.get_mut(*place) {
                    known.wait_until(Some(looked_us));
                }
            }
        }
    }
    let mut longest = 0;
    for mut known in followed {
        known.ages(way, end_us);
        partner.begun_anew += (known.stretches.len() as u64).saturating_sub(1);
        if let Some((length, ppm)) = known.drift_ppm()
            && length > longest
        {
            longest = length;
            partner.drift_ppm = Some(ppm);
        }
        partner.frames.push(known.account);
    }
    partner
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::medium::PS_IN_US;
    use crate::medium::clock::{Clock, Life};
    use crate::pictures::{RegionStates, StateSpan};
    use crate::system::read::read;
    use crate::system::wiring::{Links, wires};
    use esm_link::frames::configuration::Content;
    use esm_link::frames::wire::Header;

    const FRAME: u16 = 7;
    const PERIOD_US: u64 = 20_000;
    const LOOK_US: u64 = 10_000;
    const MINUTE_US: u64 = 60_000_000;

    fn configuration(payload_bytes: u8) -> Configuration {
        let period_us = PERIOD_US as u32;
        Configuration::of(FRAME, Content::Value("Twist"), payload_bytes, period_us)
    }

    fn link(direction: &'static str, payload_bytes: u8) -> WiredLink {
        let frame = FrameRow {
            frame: "twist".to_owned(),
            id: FRAME,
            direction,
            type_name: Some("Twist".to_owned()),
            flags: Vec::new(),
            payload_bytes: payload_bytes.into(),
            period_us: PERIOD_US as u32,
            start_us: None,
            late_us: None,
            configuration: format!("{:016x}", configuration(payload_bytes).hash()),
        };
        WiredLink {
            name: "line".to_owned(),
            rate_bps: 115_200,
            bits: 10,
            frames: vec![frame],
            receive_states: vec![("hearing".to_owned(), "Hear".to_owned())],
        }
    }

    /// A mission whose state `Hear` was current at these times.
    fn states(spans_us: &[(u64, u64)]) -> MissionStates {
        let span = |(start_us, end_us): &(u64, u64)| StateSpan {
            state: "Hear".to_owned(),
            start_us: *start_us,
            end_us: *end_us,
        };
        MissionStates {
            name: "m".into(),
            start_us: 0,
            end_us: MINUTE_US,
            regions: vec![RegionStates {
                path: "hearing".to_owned(),
                spans: spans_us.iter().map(span).collect(),
            }],
        }
    }

    /// What a receiver found, and the same by plant time.
    struct Seen {
        partner: Partner,
        age_us: f64,
        largest_age_us: f64,
        taken: u64,
    }

    /// A minute in which one sends and one receives, each by its own clock, over this medium.
    /// `number` says which number the sender gives an occurrence.
    fn minute(
        words: &str,
        payload_bytes: u8,
        (sends, receives): (Clock, Clock),
        number: impl Fn(u64) -> u64,
    ) -> Seen {
        let text = format!(
            "processor a mission \"a\"; processor b mission \"b\"; link a.line to b.line {words};"
        );
        let system = read(&text).0.unwrap();
        let of = |processor, clock, direction| Links {
            processor,
            life: Life::whole(clock),
            links: vec![link(direction, payload_bytes)],
        };
        let processors = [of(0, sends, "out"), of(1, receives, "in")];
        let mut wires = wires(&system.links, &processors, 3);
        let mut receiver = wires.ends.pop().unwrap().pop().unwrap().device;
        let mut sender = wires.ends.pop().unwrap().pop().unwrap().device;
        let length = usize::from(payload_bytes);
        let mission = Ran::new(
            Some(&processors[1].links[0]),
            &states(&[(0, MINUTE_US)]),
            false,
        );
        let received = Received::of(&mission);
        let (mut occurrence, mut newest, mut taken) = (0, None::<u64>, 0);
        let mut largest_us = 0.0_f64;
        let start_ps = |nth: u64| sends.plant_ps(5_000 + nth * PERIOD_US);
        let age_us = |nth: u64, now_us: u64| {
            (receives.plant_ps(now_us) as f64 - start_ps(nth) as f64) / PS_IN_US as f64
        };
        for look in 1..=MINUTE_US / LOOK_US {
            let now_us = look * LOOK_US;
            while start_ps(occurrence) < receives.plant_ps(now_us) {
                let header = Header {
                    identifier: FRAME,
                    number: number(occurrence) as u8,
                    configuration: configuration(payload_bytes),
                };
                let start_us = 5_000 + occurrence * PERIOD_US;
                let nth = (occurrence as u32).to_le_bytes();
                assert!(sender.send(start_us, header, length, &mut |payload| {
                    payload.fill(0);
                    payload[..4].copy_from_slice(&nth);
                }));
                occurrence += 1;
            }
            receiver.receive(now_us, &received, &mut |arrived, _| {
                let Ok(arrived) = arrived else { return };
                let nth = u32::from_le_bytes(*arrived.payload.first_chunk().unwrap()).into();
                if newest.is_some_and(|newest| number(newest) == number(nth)) {
                    return;
                }
                if let Some(newest) = newest {
                    largest_us = largest_us.max(age_us(newest, now_us));
                }
                newest = Some(nth);
                taken += 1;
            });
        }
        let age_us = age_us(newest.unwrap(), MINUTE_US);
        let arrived = wires.traffic.arrived();
        let [_, arrivals] = arrived[0].as_ref().unwrap();
        let way = Way::new(&system.links[0], &processors[1].links[0]);
        Seen {
            partner: known(arrivals, &[mission], &way, MINUTE_US),
            age_us,
            largest_age_us: largest_us.max(age_us),
            taken,
        }
    }

    #[test]
    fn ages_are_right_to_a_millisecond_and_the_drift_to_a_few_millionths() {
        let clocks = |one, other| (Clock::new(0, one), Clock::new(3_000 * PS_IN_US, other));
        for (words, payload_bytes) in [
            ("", 42),
            ("delay 900 us noise 1e-5 loss 10 %", 42),
            ("cut 20 s to 21 s", 8),
            ("byte_loss 0.1 %", 8),
            ("over memory", 42),
            ("over can loss 10 %", 8),
        ] {
            for (of_sender, of_receiver) in [(100_000, -100_000), (0, 37_500), (-80_000, 0)] {
                let seen = minute(words, payload_bytes, clocks(of_sender, of_receiver), |n| n);
                let said = &seen.partner;
                let expected_ppm = f64::from(of_sender - of_receiver) / 1e3;
                let drift_ppm = said.drift_ppm.unwrap();
                assert!(
                    (drift_ppm - expected_ppm).abs() < 0.5,
                    "{words} {drift_ppm}"
                );
                let frame = &said.frames[0];
                assert_eq!(frame.received, seen.taken, "{words}");
                for (said_us, true_us) in [
                    (frame.age_us.unwrap(), seen.age_us),
                    (frame.largest_age_us.unwrap(), seen.largest_age_us),
                ] {
                    assert!(
                        (said_us - true_us).abs() < 1_000.0,
                        "{words} {said_us} {true_us}"
                    );
                }
                // Some 3,000 starts: those that arrived and those that did not.
                let all = frame.received + frame.lost;
                assert!((2_990..=3_001).contains(&all), "{words} {all}");
                // Of 3,000, three in a row are lost that often.
                let late = match words {
                    "cut 20 s to 21 s" => 1..=1,
                    lossy if lossy.contains("loss 10") => 1..=10,
                    _ => 0..=0,
                };
                assert!(late.contains(&frame.late), "{words} {}", frame.late);
                assert_eq!((frame.doubled, frame.dropped, said.begun_anew), (0, 0, 0));
                // What is damaged may have any identifier and configuration.
                let wrong = said.corrupt + said.unknown + said.other_configuration;
                let is_damaged = words.contains("1e-5") || words.contains("byte");
                assert_eq!(
                    (said.corrupt > 0, wrong > 0),
                    (is_damaged, is_damaged),
                    "{words}"
                );
            }
        }
    }

    #[test]
    fn numbers_that_come_again_or_leap_are_told() {
        let clock = (Clock::new(0, 0), Clock::new(0, 0));
        // Each third number twice.
        let doubled = minute("", 8, clock, |nth| nth - nth % 3 / 2).partner;
        let frame = &doubled.frames[0];
        assert!((995..=1_001).contains(&frame.doubled), "{frame:?}");
        // The number behind is left out.
        assert!(frame.doubled.abs_diff(frame.lost) <= 1, "{frame:?}");
        // Someone begins anew after half of the time.
        let anew = minute("", 8, clock, |nth| (nth + 100) % 1_500).partner;
        assert_eq!(anew.begun_anew, 2, "{anew:?}");
        assert_eq!(anew.drift_ppm.map(libm::round), Some(0.0));
    }

    #[test]
    fn a_mission_with_other_frames_takes_over_and_the_drift_is_that_of_one_stretch() {
        let (one, other) = (link("in", 8), link("in", 9));
        let system = read(
            "processor a mission \"a\"; processor b mission \"b\"; link a.line to b.line over memory;",
        );
        let way = Way::new(&system.0.unwrap().links[0], &one);
        let mut arrivals = Arrivals::default();
        // A mission of the partner takes over after 3 s, with other start times of its frames.
        for nth in 0..1_000 {
            let at_us = 5_000 + nth * (PERIOD_US + 2) + if nth < 150 { 0 } else { 4_000 };
            let came = Came::Frame {
                identifier: FRAME,
                number: nth as u8,
            };
            arrivals.look(at_us);
            arrivals.take(at_us, came);
        }
        let took_over_us = arrivals.all[500].taken_us;
        let whole = states(&[(0, took_over_us)]);
        let later = MissionStates {
            start_us: took_over_us,
            ..states(&[(took_over_us, MINUTE_US)])
        };
        let missions = [
            Ran::new(Some(&one), &whole, false),
            Ran::new(Some(&other), &later, true),
        ];
        let partner = known(&arrivals, &missions, &way, MINUTE_US);
        // 2 us in 20,000.
        assert_eq!(partner.drift_ppm.map(libm::round), Some(-100.0));
        assert_eq!(partner.begun_anew, 1);
        let [before, behind] = &partner.frames[..] else {
            panic!("{partner:?}");
        };
        // The one that came in the macro step of the exchange came too early for the next mission.
        let counts = [before.received, behind.received, behind.dropped];
        assert_eq!(counts, [500, 499, 1]);
        let age_us = before.age_us.unwrap();
        assert!((age_us - 20_002.0).abs() < 1.0, "{age_us}");
    }

    fn arrival(at_us: u64, taken_us: u64, came: Came) -> Arrival {
        Arrival {
            at_us,
            taken_us,
            before_us: taken_us.checked_sub(LOOK_US),
            came,
        }
    }

    #[test]
    fn what_comes_while_nobody_receives_is_dropped_and_errors_are_told_apart() {
        let declared = link("in", 8);
        let system = read(
            "processor a mission \"a\"; processor b mission \"b\"; link a.line to b.line over memory;",
        );
        let way = Way::new(&system.0.unwrap().links[0], &declared);
        let frame = |number| Came::Frame {
            identifier: FRAME,
            number,
        };
        let arrivals = Arrivals {
            all: vec![
                arrival(10_000, 20_000, frame(1)),
                arrival(30_000, 40_000, frame(2)),
                arrival(35_000, 40_000, Came::Wrong(ReceiveError::Length)),
                arrival(36_000, 40_000, Came::Wrong(ReceiveError::Configuration)),
                arrival(37_000, 40_000, Came::Wrong(ReceiveError::UnknownIdentifier)),
                arrival(38_000, 40_000, Came::Wire(None)),
                // In a state that does not receive, and in the macro step that enters the next.
                arrival(70_000, 110_000, frame(4)),
                arrival(100_000, 110_000, frame(5)),
                arrival(100_000, 110_000, Came::Wrong(ReceiveError::Checksum)),
                arrival(110_000, 110_000, frame(6)),
            ],
            looked_us: Some(170_000),
            before_us: Some(160_000),
        };
        let spans = [(0, 30_000), (30_000, 60_000), (100_000, 180_000)];
        let mission = Ran::new(Some(&declared), &states(&spans), false);
        assert_eq!(mission.listened_us, [(0, 60_000), (100_000, 180_000)]);
        let partner = known(&arrivals, &[mission], &way, 180_000);
        let frame = FrameAccount {
            frame: "twist".to_owned(),
            id: FRAME,
            period_us: PERIOD_US as u32,
            received: 3,
            lost: 3,
            doubled: 0,
            dropped: 2,
            late: 0,
            age_us: Some(70_000.0),
            largest_age_us: Some(80_000.0),
        };
        let expected = Partner {
            drift_ppm: None,
            corrupt: 2,
            other_configuration: 1,
            unknown: 1,
            begun_anew: 0,
            frames: vec![frame],
        };
        assert_eq!(partner, expected);
        // More than three periods without one.
        let late = Arrivals {
            all: arrivals.all[..1].to_vec(),
            looked_us: Some(90_000),
            before_us: Some(80_000),
        };
        for (spans, expected) in [([(0, 180_000)], 1), ([(0, 80_000)], 0)] {
            let mission = Ran::new(Some(&declared), &states(&spans), false);
            let partner = known(&late, &[mission], &way, 180_000);
            assert_eq!(partner.frames[0].late, expected, "{spans:?}");
        }
    }
}
