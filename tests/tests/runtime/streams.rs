//! Streams and news: what they tell, and that neither slots nor requests wait for them.

use esm_link::frame::{MAX_FRAME_BYTES, MAX_REPLY_FRAME_BYTES, decode, encode};
use esm_link::message::{FromDevice, Mode, Request, ToDevice};
use esm_link::status_event::{Cause, StatusEvent};
use esm_link::telemetry::MAX_VALUE_WORDS;

use crate::counting;
use crate::mission::hash;
use crate::robot::{Answer, Bench, Values, with_robot};
use crate::values::ask_values;
use crate::warm::listening;

/// Bytes of the longest frame of a stream.
const PART_FRAME_BYTES: usize = 113;

/// Asks for all that there is of a mission, each millisecond if need be.
fn want_everything(robot: &mut Bench<'_, '_, '_>, blob: &[u8]) {
    robot
        .ask(Request::Subscribe {
            trace: true,
            log: true,
            record: false,
        })
        .unwrap();
    robot
        .ask(Request::Watch {
            news: true,
            period_ms: 1,
        })
        .unwrap();
    let ask = ask_values(hash(blob), 0, &[0; MAX_VALUE_WORDS]);
    robot.ask(Request::Values { ask: &ask }).unwrap();
}

#[test]
fn an_answer_waits_for_the_rest_of_one_part_at_most_however_full_the_wire() {
    with_robot(|robot| {
        let blob = listening(1, false);
        robot.start(&blob);
        want_everything(robot, &blob);
        robot.wire.log.extend([b'x'; 200_000]);
        robot.wire.room = Some(0);
        let mut longest = 0;
        for round in 0..300_u32 {
            // The wire takes a byte at a time, and the request comes at any place of a frame.
            robot.run_us(1_700);
            let before = 1 + (round as usize * 37) % PART_FRAME_BYTES;
            robot.wire.to_host.clear();
            for _ in 0..before {
                robot.wire.room = Some(1);
                robot.link.poll(&mut robot.wire);
            }
            robot.wire.to_host.clear();
            let mut frame = [0; MAX_FRAME_BYTES];
            let seq = round as u8;
            let request = Request::Status;
            let length = encode(&ToDevice { seq, request }, &mut frame).unwrap();
            robot.wire.to_robot.extend(&frame[..length]);
            let mut frame = Vec::new();
            let mut sent = 0;
            let waited = loop {
                robot.wire.room = Some(1);
                robot.link.poll(&mut robot.wire);
                let byte = robot
                    .wire
                    .to_host
                    .pop_front()
                    .expect("there is more to send");
                sent += 1;
                assert!(sent <= 10 * PART_FRAME_BYTES, "no answer in round {round}");
                frame.push(byte);
                if byte != 0 {
                    continue;
                }
                let length = frame.len();
                // The first may have begun before the request.
                match decode(&mut frame) {
                    Ok(FromDevice::Reply { seq: answered, .. }) if answered == seq => {
                        assert!(length <= MAX_REPLY_FRAME_BYTES);
                        break sent - length;
                    }
                    _ => frame.clear(),
                }
            };
            longest = longest.max(waited);
        }
        assert!(
            longest <= PART_FRAME_BYTES,
            "an answer waited for {longest} bytes"
        );
        assert!(
            longest > PART_FRAME_BYTES / 2,
            "the wire was too empty to tell: {longest}"
        );
    });
}

#[test]
fn an_answer_that_was_begun_is_sent_to_its_end_before_the_next() {
    with_robot(|robot| {
        let blob = listening(1, false);
        robot.start(&blob);
        let (len, crc) = (300, 5);
        robot.ask(Request::Begin { len, crc }).unwrap();
        let (offset, data) = (0, &[0x5a; 50][..]);
        let chunk = robot.frame(Request::Chunk { offset, data });
        let of_chunk = robot.last_number();
        let start = robot.frame(Request::Start);
        robot.wire.to_robot.extend(chunk);
        robot.wire.to_robot.extend(start);
        // The wire takes some bytes of the first answer when the second request is there.
        robot.wire.room = Some(0);
        assert_eq!(robot.exchange(), []);
        robot.wire.room = Some(3);
        assert_eq!(robot.exchange(), []);
        robot.run_us(10_000);
        robot.wire.room = None;
        let expected = [
            (of_chunk, Ok(Answer::Received(50))),
            (robot.last_number(), Ok(Answer::Done)),
        ];
        // The second is carried out when the first is sent.
        let mut answers = robot.exchange();
        robot.wire.room = Some(0);
        robot.run_us(10_000);
        robot.wire.room = None;
        answers.extend(robot.exchange());
        assert_eq!(answers, expected);
    });
}

#[test]
fn nothing_of_the_session_before_comes_behind_the_answer_to_hello() {
    with_robot(|robot| {
        let blob = listening(1, false);
        robot.start(&blob);
        want_everything(robot, &blob);
        for begun in [0, 5] {
            robot.wire.log.extend([b'x'; 10_000]);
            robot.wire.room = Some(0);
            robot.run_us(50_000);
            robot.wire.room = Some(begun);
            robot.link.poll(&mut robot.wire);
            let hello = robot.frame(Request::Hello);
            let asked = robot.last_number();
            robot.wire.to_robot.extend(hello);
            robot.wire.room = None;
            while robot.link.poll(&mut robot.wire) {}
            let sent: Vec<u8> = robot.wire.to_host.drain(..).collect();
            let mut frames: Vec<_> = sent.split_inclusive(|byte| *byte == 0).collect();
            let mut last = frames.pop().expect("an answer").to_vec();
            assert_eq!(frames.len(), usize::from(begun > 0), "what was begun");
            let Ok(FromDevice::Reply { seq, .. }) = decode(&mut last) else {
                panic!("no answer comes last");
            };
            assert_eq!(seq, asked);
            want_everything(robot, &blob);
        }
    });
}

#[test]
fn a_client_that_never_reads_costs_no_slot_and_finds_the_robot_in_step() {
    with_robot(|robot| {
        let blob = listening(1, false);
        robot.start(&blob);
        want_everything(robot, &blob);
        robot.wire.log.extend([b'x'; 60_000]);
        let before = robot.status();
        robot.wire.stuck = true;
        robot.run_us(2_000_000);
        robot.wire.stuck = false;
        let after = robot.status();
        assert_eq!(
            (after.mode, after.missed, after.overruns),
            (Mode::Running, 0, 0)
        );
        assert_eq!(after.steps - before.steps, 200, "each macro step of 10 ms");
        assert!(after.trace_dropped > 0, "there was no room for all of it");
        robot.run_us(100_000);
        // One was there, and one more comes from when there is room again.
        let dropped = robot.samples_dropped;
        assert!((190..=200).contains(&dropped), "{dropped} samples dropped");
        let last = robot.values.last().cloned();
        let Some(Values::Sample(_, has, t_us, words)) = last else {
            panic!("{last:?}");
        };
        let counted = 2 * (t_us / 10_000) as u32;
        assert_eq!(
            (has, words),
            ((1 << MAX_VALUE_WORDS) - 1, vec![counted; MAX_VALUE_WORDS])
        );
    });
}

#[test]
fn news_tell_what_changes_and_how_it_is_each_period() {
    with_robot(|robot| {
        let watch = |news, period_ms| Request::Watch { news, period_ms };
        let told = |news: &[StatusEvent]| -> Vec<(u8, Cause, Mode)> {
            news.iter()
                .map(|news| (news.seq, news.cause, news.mode))
                .collect()
        };
        robot.ask(watch(true, 0)).unwrap();
        robot.run_us(50_000);
        assert_eq!(told(&robot.news), [(0, Cause::Begun, Mode::Empty)]);
        robot.news.clear();

        robot.start(&counting(1_000_000).blob());
        robot.run_us(100_000);
        robot.ask(Request::Stop).unwrap();
        robot.ask(Request::Start).unwrap();
        robot.run_us(1_000);
        let causes = told(&robot.news);
        assert_eq!(
            causes,
            [
                (1, Cause::Mission, Mode::Running),
                (2, Cause::Mode, Mode::Stopped),
                (3, Cause::Mode, Mode::Running),
            ]
        );
        robot.news.clear();

        robot.ask(watch(true, 50)).unwrap();
        robot.wire.to_robot.extend([7, 7, 7, 0]);
        robot.run_us(500_000);
        let causes = told(&robot.news);
        assert_eq!(causes.first(), Some(&(0, Cause::Begun, Mode::Running)));
        assert_eq!(causes.len(), 11, "{causes:?}");
        assert!(
            causes[1..]
                .iter()
                .all(|(_, cause, _)| *cause == Cause::Period)
        );
        let times: Vec<u64> = robot.news.iter().map(|news| news.t_us).collect();
        assert!(
            times.windows(2).all(|pair| pair[1] - pair[0] == 50_000),
            "{times:?}"
        );
        assert_eq!(robot.news.last().unwrap().corrupt_frames, 1);
        robot.news.clear();

        // A new session is told nothing that the one before wanted.
        robot.ask(Request::Hello).unwrap();
        robot.run_us(500_000);
        assert_eq!(robot.news, []);
    });
}

#[test]
fn an_answer_of_the_real_time_side_gives_way_to_no_chunk() {
    with_robot(|robot| {
        let blob = listening(1, false);
        robot.start(&blob);
        let (len, crc) = (300, 5);
        robot.ask(Request::Begin { len, crc }).unwrap();
        let data = &[0x5a; 50][..];
        robot.ask(Request::Chunk { offset: 0, data }).unwrap();
        // Its answer is there, and the wire takes nothing of it, when the chunk comes.
        let start = robot.frame(Request::Start);
        let of_start = robot.last_number();
        robot.wire.to_robot.extend(start);
        robot.exchange();
        robot.wire.room = Some(0);
        robot.run_us(10_000);
        let chunk = robot.frame(Request::Chunk { offset: 50, data });
        robot.wire.to_robot.extend(chunk);
        robot.exchange();
        robot.wire.room = None;
        let expected = [
            (of_start, Ok(Answer::Done)),
            (robot.last_number(), Ok(Answer::Received(100))),
        ];
        assert_eq!(robot.exchange(), expected);
    });
}
