//! A robot with a key, and hosts that have another one, or none.

use esm_link::access::{
    self, Access, KEY_BYTES, MAX_COUNTER_STEP, NO_UPLOAD, NONCE_BYTES, NONCE_LIFE_US, Needs,
    PROOF_BYTES, SALT_BYTES, SECRET_BYTES, SIGNATURE_BYTES, needs,
};
use esm_link::keys::PAUSE_AFTER_WRONG_US;
use esm_link::message::{LinkError, MAX_CHUNK, Mode, Request, Swap};
use esm_link::proof::mask;
use esm_tests::owner::{Installation, bytes_of};
use host_tools::keys::SigningKey;

use super::counting;
use super::mission::hash;
use super::robot::{Answer, Bench, Safe, with_robot};

const SALT: [u8; SALT_BYTES] = [0x5e; SALT_BYTES];

fn key(number: u8) -> SigningKey {
    SigningKey::of(&[number; 32])
}

fn install(robot: &mut Bench<'_, '_, '_>, key: &SigningKey) -> Result<Answer, LinkError> {
    robot.ask(Installation::of(key, SALT).request())
}

/// What brings another key to a robot in a session, so that who listens does not learn its secret.
fn replacement(
    robot: &Bench<'_, '_, '_>,
    key: &SigningKey,
    salt: [u8; SALT_BYTES],
) -> Installation {
    let owner = robot.owner.as_ref().expect("a session");
    Installation::with(key, salt, mask(key.secret(&salt), &owner.session, &salt))
}

/// A robot that drives a mission, has `key(1)`, and can be asked for everything.
fn with_locked_robot(test: impl FnOnce(&mut Bench<'_, '_, '_>)) {
    with_robot(|robot| {
        robot.wire.safe = Some(Safe::default());
        robot.start(&counting(1_000_000).blob());
        assert_eq!(install(robot, &key(1)), Ok(Answer::Done));
        robot.run_us(100_000);
        assert_eq!(robot.open_session(&key(1)), Ok(Answer::Done));
        test(robot);
    });
}

fn challenge(robot: &mut Bench<'_, '_, '_>) -> ([u8; NONCE_BYTES], u64) {
    match robot.ask(Request::Challenge) {
        Ok(Answer::Challenge { nonce, counter }) => (nonce, counter),
        other => panic!("{other:?}"),
    }
}

/// Asks for a nonce, signs with it, and sends.
fn ask_signed(
    robot: &mut Bench<'_, '_, '_>,
    key: &SigningKey,
    upload: &[u8; SIGNATURE_BYTES],
    request: Request<'_>,
) -> Result<Answer, LinkError> {
    let (nonce, _) = challenge(robot);
    let request = bytes_of(&request);
    let signature = key.sign(&access::command(&nonce, upload, &request));
    robot.ask(Request::Signed {
        signature: &signature,
        request: &request,
    })
}

fn sign(
    robot: &mut Bench<'_, '_, '_>,
    key: &SigningKey,
    counter: u64,
    blob: &[u8],
) -> (Result<Answer, LinkError>, [u8; SIGNATURE_BYTES]) {
    let signature = key.sign(&access::upload(&SALT, &counter.to_le_bytes(), blob));
    let answer = robot.ask(Request::Sign {
        counter,
        signature: &signature,
    });
    (answer, signature)
}

/// What nobody but the owner of the key may change.
fn standing(robot: &mut Bench<'_, '_, '_>) -> (Option<u32>, Mode, u32, Option<Safe>) {
    let status = robot.status();
    let safe = robot.wire.safe.clone();
    (status.mission, status.mode, robot.board.motors_off, safe)
}

/// Lets the robot look at signatures again.
fn pause(robot: &mut Bench<'_, '_, '_>) {
    robot.run_us(PAUSE_AFTER_WRONG_US);
}

#[test]
fn a_robot_without_a_key_takes_what_it_always_took() {
    with_robot(|robot| {
        assert_eq!(robot.access(), Access::Unsupported);
        assert_eq!(install(robot, &key(1)), Err(LinkError::NoKeySupport));
        assert_eq!(
            robot.ask(Request::Challenge),
            Err(LinkError::NoKeySupport),
            "there is nowhere to keep one"
        );
        let identify = Request::Identify {
            nonce: [1; NONCE_BYTES],
        };
        assert_eq!(robot.ask(identify), Err(LinkError::NoKeySupport));
        robot.start(&counting(3).blob());
        robot.wire.safe = Some(Safe::default());
        assert_eq!(robot.access(), Access::Open);
        assert_eq!(robot.ask(Request::Challenge), Err(LinkError::NoKey));
        assert_eq!(robot.ask(identify), Err(LinkError::NoKey));
        assert_eq!(robot.ask(Request::RemoveKey), Err(LinkError::NoKey));
        assert_eq!(robot.ask(Request::Start), Ok(Answer::Done));
        robot.start(&counting(4).blob());
    });
}

#[test]
fn with_its_key_everything_can_be_done() {
    with_locked_robot(|robot| {
        assert_eq!(robot.access(), Access::Locked);
        assert_eq!(robot.ask(Request::Stop), Ok(Answer::Done), "anyone may");
        assert_eq!(
            ask_signed(robot, &key(1), &NO_UPLOAD, Request::Start),
            Ok(Answer::Done)
        );
        assert_eq!(robot.status().mode, Mode::Running);
        let blob = counting(7).blob();
        let hash = u32::from_le_bytes(*blob.last_chunk().unwrap());
        robot.send(&blob);
        let (answer, signature) = sign(robot, &key(1), 1, &blob);
        assert_eq!(answer, Ok(Answer::Done));
        assert_eq!(
            ask_signed(robot, &key(1), &signature, Request::Commit(Swap::default())),
            Ok(Answer::Committed(hash))
        );
        assert_eq!(challenge(robot).1, 1, "it was upload number 1");
        // Another key, which the first one lets in. Its session ends with that.
        let other = replacement(robot, &key(2), SALT);
        let request = other.request();
        assert_eq!(
            ask_signed(robot, &key(1), &NO_UPLOAD, request),
            Ok(Answer::Done)
        );
        assert_eq!(robot.ask(Request::Status), Err(LinkError::NoSession));
        assert_eq!(robot.open_session(&key(2)), Ok(Answer::Done));
        assert_eq!(
            ask_signed(robot, &key(1), &NO_UPLOAD, Request::Start),
            Err(LinkError::WrongSignature)
        );
        pause(robot);
        assert_eq!(
            ask_signed(robot, &key(2), &NO_UPLOAD, Request::RemoveKey),
            Ok(Answer::Done)
        );
        robot.owner = None;
        assert_eq!(robot.access(), Access::Open);
        assert_eq!(robot.ask(Request::Start), Ok(Answer::Done));
    });
}

#[test]
fn what_is_kept_holds_though_the_flash_said_that_it_is_not() {
    fn doubt(robot: &mut Bench<'_, '_, '_>, doubtful: bool) {
        if let Some(safe) = &mut robot.wire.safe {
            safe.doubtful = doubtful;
        }
    }
    with_robot(|robot| {
        robot.wire.safe = Some(Safe::default());
        doubt(robot, true);
        assert_eq!(install(robot, &key(1)), Err(LinkError::NotStored));
        assert_eq!(robot.access(), Access::Locked);
        assert_eq!(robot.ask(Request::Start), Err(LinkError::NeedsKey));
        doubt(robot, false);
        assert_eq!(robot.open_session(&key(1)), Ok(Answer::Done));
        let blob = counting(5).blob();
        robot.send(&blob);
        let (signed, signature) = sign(robot, &key(1), 1, &blob);
        assert_eq!(signed, Ok(Answer::Done));
        let commit = Request::Commit(Swap::default());
        // The first nonce after a start is one more record.
        challenge(robot);
        doubt(robot, true);
        let committed = ask_signed(robot, &key(1), &signature, commit);
        assert_eq!(committed, Err(LinkError::NotStored));
        assert_eq!(challenge(robot).1, 1, "the number is used up");
        // A new key voids what the one before has signed, also where it is said not to be kept.
        robot.send(&blob);
        assert_eq!(sign(robot, &key(1), 2, &blob).0, Ok(Answer::Done));
        let other = replacement(robot, &key(2), SALT);
        let request = other.request();
        let replaced = ask_signed(robot, &key(1), &NO_UPLOAD, request);
        assert_eq!(replaced, Err(LinkError::NotStored));
        // A session takes a record, unless one was opened since the start.
        assert_eq!(robot.open_session(&key(2)), Ok(Answer::Done));
        let committed = ask_signed(robot, &key(2), &NO_UPLOAD, commit);
        assert_eq!(committed, Err(LinkError::NotSigned));
        let removed = ask_signed(robot, &key(2), &NO_UPLOAD, Request::RemoveKey);
        assert_eq!(removed, Err(LinkError::NotStored));
        robot.owner = None;
        assert_eq!(robot.access(), Access::Open);
    });
}

#[test]
fn a_robot_of_which_nobody_knows_whether_it_has_a_key_is_locked() {
    with_robot(|robot| {
        robot.wire.safe = Some(Safe::default());
        assert_eq!(robot.access(), Access::Open);
        let safe = robot.wire.safe.as_mut();
        safe.expect("it is there").broken = true;
        assert_eq!(install(robot, &key(1)), Err(LinkError::NotStored));
        assert_eq!(robot.access(), Access::Unreadable);
        assert_eq!(robot.ask(Request::Start), Err(LinkError::NotStored));
    });
}

#[test]
fn a_signature_that_was_found_right_is_not_verified_again() {
    with_locked_robot(|robot| {
        let blob = counting(5).blob();
        robot.send(&blob);
        let (right, _) = sign(robot, &key(1), 1, &blob);
        assert_eq!(right, Ok(Answer::Done));
        let (wrong, _) = sign(robot, &key(2), 1, &blob);
        assert_eq!(wrong, Err(LinkError::WrongSignature));
        // No signature is verified for a while.
        let (again, signature) = sign(robot, &key(1), 1, &blob);
        assert_eq!(again, Ok(Answer::Done));
        let (newer, _) = sign(robot, &key(1), 2, &blob);
        assert!(matches!(newer, Err(LinkError::TooSoon { .. })), "{newer:?}");
        pause(robot);
        assert_eq!(
            ask_signed(robot, &key(1), &signature, Request::Commit(Swap::default())),
            Ok(Answer::Committed(hash(&blob)))
        );
        // An upload of the same bytes is another one.
        robot.send(&blob);
        let (old, _) = sign(robot, &key(1), 1, &blob);
        assert_eq!(old, Err(LinkError::OldCounter { last: 1 }));
    });
}

#[test]
fn without_a_signature_nothing_is_changed() {
    with_locked_robot(|robot| {
        let before = standing(robot);
        let blob = counting(5).blob();
        robot.send(&blob);
        let other = replacement(robot, &key(2), SALT);
        let requests = [
            Request::Commit(Swap::default()),
            Request::Confirm { mission: 1 },
            Request::FallBack { mission: 1 },
            Request::Start,
            Request::RemoveKey,
            other.request(),
        ];
        for request in requests {
            assert_eq!(needs(&request), Needs::Key);
            assert_eq!(
                robot.ask(request),
                Err(LinkError::NeedsKey),
                "{request:?} as it is"
            );
            assert_eq!(
                robot.ask(Request::Signed {
                    signature: &[0; SIGNATURE_BYTES],
                    request: &bytes_of(&request)
                }),
                Err(LinkError::NoChallenge),
                "{request:?} without a nonce"
            );
            assert_eq!(
                ask_signed(robot, &key(2), &NO_UPLOAD, request),
                Err(LinkError::WrongSignature),
                "{request:?} with another key"
            );
            pause(robot);
        }
        assert_eq!(
            ask_signed(robot, &key(1), &NO_UPLOAD, Request::Commit(Swap::default())),
            Err(LinkError::NotSigned),
            "the owner commits what the owner has not signed"
        );
        pause(robot);
        let after = standing(robot);
        assert_eq!((before.0, before.1, before.2), (after.0, after.1, after.2));
        assert_eq!(robot.access(), Access::Locked);
        // And the owner goes on as if nothing had been there.
        let (answer, signature) = sign(robot, &key(1), 1, &blob);
        assert_eq!(answer, Ok(Answer::Done));
        assert!(ask_signed(robot, &key(1), &signature, Request::Commit(Swap::default())).is_ok());
    });
}

#[test]
fn every_changed_bit_of_a_signature_spoils_it() {
    with_locked_robot(|robot| {
        let before = standing(robot).0;
        let request = bytes_of(&Request::Start);
        // The bits of a signature's two numbers are all alike; this takes some of each byte.
        for bit in (0..SIGNATURE_BYTES * 8).step_by(7) {
            let (nonce, _) = challenge(robot);
            let mut signature = key(1).sign(&access::command(&nonce, &NO_UPLOAD, &request));
            signature[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(
                robot.ask(Request::Signed {
                    signature: &signature,
                    request: &request
                }),
                Err(LinkError::WrongSignature),
                "bit {bit}"
            );
            pause(robot);
        }
        assert_eq!(standing(robot).0, before);
    });
}

#[test]
fn a_signature_is_good_for_one_request_once() {
    with_locked_robot(|robot| {
        assert_eq!(robot.ask(Request::Stop), Ok(Answer::Done));
        let (nonce, _) = challenge(robot);
        let request = bytes_of(&Request::Start);
        let signature = key(1).sign(&access::command(&nonce, &NO_UPLOAD, &request));
        let signed = Request::Signed {
            signature: &signature,
            request: &request,
        };
        assert_eq!(
            robot.ask(Request::Signed {
                signature: &signature,
                request: &bytes_of(&Request::RemoveKey)
            }),
            Err(LinkError::WrongSignature),
            "of another request"
        );
        pause(robot);
        assert_eq!(
            robot.ask(signed),
            Err(LinkError::NoChallenge),
            "the nonce went with the first try"
        );
        let (other, _) = challenge(robot);
        assert_ne!(other, nonce);
        assert_eq!(
            robot.ask(signed),
            Err(LinkError::WrongSignature),
            "of another nonce"
        );
        pause(robot);
        let (nonce, _) = challenge(robot);
        let signature = key(1).sign(&access::command(&nonce, &NO_UPLOAD, &request));
        let signed = Request::Signed {
            signature: &signature,
            request: &request,
        };
        assert_eq!(robot.ask(signed), Ok(Answer::Done));
        assert_eq!(robot.ask(Request::Stop), Ok(Answer::Done));
        assert_eq!(robot.ask(signed), Err(LinkError::NoChallenge), "replayed");
        // Everyone may stop it, and only the key ends that.
        assert_eq!(robot.ask(Request::EmergencyStop), Ok(Answer::Done));
        assert_eq!(robot.ask(Request::Release), Err(LinkError::NeedsKey));
        assert_eq!(robot.status().mode, Mode::EmergencyStopped);
        let released = ask_signed(robot, &key(1), &NO_UPLOAD, Request::Release);
        assert_eq!(released, Ok(Answer::Done));
        assert_eq!(robot.status().mode, Mode::Stopped);
    });
}

#[test]
fn what_was_recorded_before_a_reset_is_of_no_use_after_it() {
    let mut kept = None;
    let mut nonces = Vec::new();
    for _ in 0..3 {
        with_robot(|robot| {
            // The clock begins anew with each start, and so does what is asked.
            robot.wire.safe = Some(kept.clone().unwrap_or_default());
            if kept.is_none() {
                assert_eq!(install(robot, &key(1)), Ok(Answer::Done));
            }
            assert_eq!(robot.access(), Access::Locked);
            assert_eq!(robot.open_session(&key(1)), Ok(Answer::Done));
            nonces.push(challenge(robot).0);
            nonces.push(challenge(robot).0);
            kept = robot.wire.safe.take();
        });
    }
    let all = nonces.len();
    nonces.sort();
    nonces.dedup();
    assert_eq!(nonces.len(), all);
}

#[test]
fn an_upload_is_accepted_once_and_none_older() {
    with_locked_robot(|robot| {
        let (old, new) = (counting(5).blob(), counting(6).blob());
        for (counter, blob, expected) in [
            (10, &old, Ok(Answer::Done)),
            (10, &old, Err(LinkError::OldCounter { last: 10 })),
            (9, &new, Err(LinkError::OldCounter { last: 10 })),
            (0, &new, Err(LinkError::OldCounter { last: 10 })),
            (11, &new, Ok(Answer::Done)),
            (10, &old, Err(LinkError::OldCounter { last: 11 })),
        ] {
            robot.send(blob);
            let (answer, signature) = sign(robot, &key(1), counter, blob);
            assert_eq!(answer, expected, "number {counter}");
            let committed =
                ask_signed(robot, &key(1), &signature, Request::Commit(Swap::default()));
            match expected {
                Ok(_) => assert!(matches!(committed, Ok(Answer::Committed(_)))),
                // Its owner even wants it: the robot does not.
                Err(_) => assert_eq!(committed, Err(LinkError::WrongSignature)),
            }
            pause(robot);
            assert_eq!(robot.ask(Request::Abort), Ok(Answer::Done));
        }
        // Nor does a key that goes and comes back take the counter down.
        assert_eq!(
            ask_signed(robot, &key(1), &NO_UPLOAD, Request::RemoveKey),
            Ok(Answer::Done)
        );
        robot.owner = None;
        assert_eq!(install(robot, &key(1)), Ok(Answer::Done));
        assert_eq!(robot.open_session(&key(1)), Ok(Answer::Done));
        assert_eq!(challenge(robot).1, 11);
    });
}

#[test]
fn a_commit_is_about_the_upload_that_its_owner_has_signed() {
    with_locked_robot(|robot| {
        // The owner signed this one and did not send it off; who listened has it.
        let (held_back, wanted) = (counting(5).blob(), counting(6).blob());
        robot.send(&held_back);
        let (answer, _) = sign(robot, &key(1), 1, &held_back);
        assert_eq!(answer, Ok(Answer::Done));
        let (nonce, _) = challenge(robot);
        let request = bytes_of(&Request::Commit(Swap::default()));
        let wanted_signature = key(1).sign(&access::upload(&SALT, &1u64.to_le_bytes(), &wanted));
        let signature = key(1).sign(&access::command(&nonce, &wanted_signature, &request));
        let mission = robot.status().mission;
        assert_eq!(
            robot.ask(Request::Signed {
                signature: &signature,
                request: &request
            }),
            Err(LinkError::WrongSignature)
        );
        assert_eq!(robot.status().mission, mission);
    });
}

#[test]
fn a_signature_is_of_all_of_the_blob_that_arrived() {
    with_locked_robot(|robot| {
        let blob = counting(5).blob();
        assert_eq!(
            robot.ask(Request::Sign {
                counter: 1,
                signature: &NO_UPLOAD
            }),
            Err(LinkError::NoUpload)
        );
        let mut other = blob.clone();
        other[40] ^= 1;
        // What was not signed is forgotten.
        let refused = Err(LinkError::WrongSignature);
        robot.send(&other);
        assert_eq!(sign(robot, &key(1), 1, &blob).0, refused);
        pause(robot);
        robot.send(&other);
        assert_eq!(sign(robot, &key(2), 1, &other).0, refused);
        pause(robot);
        robot.send(&other);
        let signature = &key(1).sign(&access::upload(&SALT, &1u64.to_le_bytes(), &other));
        let of_another_number = Request::Sign {
            counter: 2,
            signature,
        };
        assert_eq!(robot.ask(of_another_number), refused);
        pause(robot);
        // A new upload begins without a signature.
        robot.send(&other);
        assert_eq!(sign(robot, &key(1), 1, &other).0, Ok(Answer::Done));
        robot.send(&blob);
        assert_eq!(
            ask_signed(robot, &key(1), &NO_UPLOAD, Request::Commit(Swap::default())),
            Err(LinkError::NotSigned)
        );
    });
}

#[test]
fn lengths_that_do_not_fit_are_no_requests() {
    with_locked_robot(|robot| {
        let long = [7; 150];
        let whole = bytes_of(&Request::Start);
        let nested = {
            let inner = bytes_of(&Request::Start);
            bytes_of(&Request::Signed {
                signature: &[1; 32],
                request: &inner,
            })
        };
        let reading = bytes_of(&Request::Status);
        let trailing = [&whole[..], &[0]].concat();
        for request in [&[][..], &long[..100], &nested, &reading, &trailing] {
            let _ = challenge(robot);
            assert_eq!(
                robot.ask(Request::Signed {
                    signature: &[1; SIGNATURE_BYTES],
                    request
                }),
                Err(LinkError::Malformed),
                "{request:?}"
            );
        }
        robot.send(&counting(3).blob());
        for signature in [&[][..], &long[..63], &long[..65], &long[..128]] {
            let _ = challenge(robot);
            assert_eq!(
                robot.ask(Request::Signed {
                    signature,
                    request: &whole
                }),
                Err(LinkError::Malformed)
            );
            assert_eq!(
                robot.ask(Request::Sign {
                    counter: 1,
                    signature
                }),
                Err(LinkError::Malformed)
            );
        }
        assert_eq!(
            ask_signed(robot, &key(1), &NO_UPLOAD, Request::Start),
            Ok(Answer::Done),
            "none of that was a wrong signature, after which there is a pause"
        );
    });
}

#[test]
fn keys_that_any_signature_fits_are_not_installed() {
    with_robot(|robot| {
        robot.wire.safe = Some(Safe::default());
        // Points of small order: with these as keys, one signature would do for many messages.
        let weak: [[u8; KEY_BYTES]; 3] = [
            [0; KEY_BYTES],
            {
                let mut one = [0; KEY_BYTES];
                one[0] = 1;
                one
            },
            {
                let mut minus_one = [0xff; KEY_BYTES];
                minus_one[0] = 0xec;
                minus_one[KEY_BYTES - 1] = 0x7f;
                minus_one
            },
        ];
        for key in weak {
            let mut signature = [0; SIGNATURE_BYTES];
            signature[..KEY_BYTES].copy_from_slice(&key);
            assert_eq!(
                robot.ask(Request::InstallKey {
                    key: &key,
                    salt: &SALT,
                    secret: &[0; SECRET_BYTES],
                    signature: &signature
                }),
                Err(LinkError::WrongSignature)
            );
            pause(robot);
        }
        // Nor one that nobody has shown to have.
        let (public, secret) = (key(1).public().0, key(1).secret(&SALT).0);
        assert_eq!(
            robot.ask(Request::InstallKey {
                key: &public,
                salt: &SALT,
                secret: &secret,
                signature: &key(2).sign(&access::install(&public, &SALT, &secret)),
            }),
            Err(LinkError::WrongSignature)
        );
        assert_eq!(robot.access(), Access::Open);
    });
}

#[test]
fn after_a_wrong_signature_none_is_looked_at_for_a_second() {
    with_locked_robot(|robot| {
        assert_eq!(
            ask_signed(robot, &key(2), &NO_UPLOAD, Request::Start),
            Err(LinkError::WrongSignature)
        );
        assert_eq!(
            ask_signed(robot, &key(1), &NO_UPLOAD, Request::Start),
            Err(LinkError::TooSoon { ms: 1000 })
        );
        robot.world.pass_us(PAUSE_AFTER_WRONG_US - 1);
        assert_eq!(
            ask_signed(robot, &key(2), &NO_UPLOAD, Request::Start),
            Err(LinkError::TooSoon { ms: 1 }),
            "which does not begin the pause anew"
        );
        robot.world.pass_us(1);
        assert_eq!(
            ask_signed(robot, &key(1), &NO_UPLOAD, Request::Start),
            Ok(Answer::Done)
        );
        assert_eq!(robot.ask(Request::Stop), Ok(Answer::Done));
    });
}

#[test]
fn where_nobody_knows_whether_there_is_a_key_nobody_may() {
    with_robot(|robot| {
        robot.start(&counting(1_000_000).blob());
        robot.wire.safe = Some(Safe {
            broken: true,
            ..Safe::default()
        });
        // The robot looked before, when there was none: a start later.
        let mut kept = None;
        std::mem::swap(&mut kept, &mut robot.wire.safe);
        with_robot(|robot| {
            robot.wire.safe = kept.take();
            assert_eq!(robot.access(), Access::Unreadable);
            assert_eq!(robot.ask(Request::Start), Err(LinkError::NotStored));
            assert_eq!(install(robot, &key(1)), Err(LinkError::NotStored));
            assert_eq!(robot.ask(Request::Stop), Ok(Answer::Done));
        });
    });
}

#[test]
fn what_cannot_be_kept_is_not_done() {
    with_locked_robot(|robot| {
        let blob = counting(5).blob();
        let mission = robot.status().mission;
        robot.send(&blob);
        let (answer, signature) = sign(robot, &key(1), 1, &blob);
        assert_eq!(answer, Ok(Answer::Done));
        let _ = challenge(robot);
        robot.wire.safe.as_mut().unwrap().broken = true;
        assert_eq!(
            ask_signed(robot, &key(1), &signature, Request::Commit(Swap::default())),
            Err(LinkError::NotStored),
            "the counter is kept before the mission runs, or it does not run"
        );
        assert_eq!(robot.status().mission, mission);
        assert_eq!(
            ask_signed(robot, &key(1), &NO_UPLOAD, Request::RemoveKey),
            Err(LinkError::NotStored)
        );
        robot.wire.safe.as_mut().unwrap().broken = false;
        assert_eq!(robot.access(), Access::Locked);
    });
}

#[test]
fn a_flood_of_wrong_requests_costs_no_slot_and_a_good_one_works_right_after_it() {
    with_locked_robot(|robot| {
        let before = standing(robot);
        let blob = counting(5).blob();
        for round in 0..300u32 {
            let noise: Vec<u8> = (0..400u32)
                .map(|i| (i.wrapping_mul(2_654_435_761).wrapping_add(round) >> 13) as u8)
                .collect();
            robot.wire.to_robot.extend(noise);
            let frames = [
                robot.frame(Request::Begin {
                    len: 4096,
                    crc: round,
                }),
                robot.frame(Request::Chunk {
                    offset: round,
                    data: &blob[..100],
                }),
                robot.frame(Request::Commit(Swap::default())),
                robot.frame(Request::Challenge),
                robot.frame(Request::Signed {
                    signature: &[round as u8; SIGNATURE_BYTES],
                    request: &bytes_of(&Request::Start),
                }),
                robot.frame(Request::Sign {
                    counter: u64::from(round),
                    signature: &[round as u8; SIGNATURE_BYTES],
                }),
                robot.frame(Request::Abort),
            ];
            robot.wire.to_robot.push_back(0);
            robot.wire.to_robot.extend(frames.concat());
            robot.run_us(20_000);
        }
        let after = standing(robot);
        assert_eq!((before.0, before.1, before.2), (after.0, after.1, after.2));
        assert_eq!(robot.status().missed, 0);
        pause(robot);
        robot.send(&blob);
        let (answer, signature) = sign(robot, &key(1), 1, &blob);
        assert_eq!(answer, Ok(Answer::Done));
        assert!(matches!(
            ask_signed(robot, &key(1), &signature, Request::Commit(Swap::default())),
            Ok(Answer::Committed(_))
        ));
    });
}

#[test]
fn strangers_take_neither_place_nor_answer_nor_nonce_from_the_owner() {
    with_locked_robot(|robot| {
        let blob = counting(5).blob();
        let len = blob.len() as u32;
        let crc = esm_link::frame::checksum(&blob);
        let flood = |robot: &mut Bench<'_, '_, '_>| {
            robot.by_anyone(|robot| {
                let frames = [
                    robot.frame(Request::Hello),
                    robot.frame(Request::Begin { len: 9, crc: 9 }),
                    robot.frame(Request::Chunk {
                        offset: 0,
                        data: &[0x5a; 9],
                    }),
                    robot.frame(Request::Abort),
                    robot.frame(Request::Challenge),
                    robot.frame(Request::Identify {
                        nonce: [9; NONCE_BYTES],
                    }),
                    robot.frame(Request::OpenSession {
                        client: [9; NONCE_BYTES],
                        robot: [9; NONCE_BYTES],
                        proof: [9; PROOF_BYTES],
                    }),
                    robot.frame(Request::Proven {
                        number: u32::MAX,
                        proof: [9; PROOF_BYTES],
                        request: &bytes_of(&Request::Abort),
                    }),
                    robot.frame(Request::Sign {
                        counter: u64::MAX - 1,
                        signature: &[9; SIGNATURE_BYTES],
                    }),
                    robot.frame(Request::Signed {
                        signature: &[9; SIGNATURE_BYTES],
                        request: &bytes_of(&Request::Start),
                    }),
                    robot.frame(Request::States { first: 0 }),
                ];
                robot.wire.to_robot.extend(frames.concat());
            });
        };
        for (request, expected) in [
            (Request::Begin { len, crc }, Answer::Received(0)),
            (
                Request::Chunk {
                    offset: 0,
                    data: &blob[..100],
                },
                Answer::Received(100),
            ),
            (Request::Begin { len, crc }, Answer::Received(100)),
        ] {
            flood(robot);
            assert_eq!(robot.ask(request), Ok(expected));
        }
        flood(robot);
        for (part, data) in blob[100..].chunks(MAX_CHUNK).enumerate() {
            let offset = (100 + part * MAX_CHUNK) as u32;
            let chunk = Request::Chunk { offset, data };
            flood(robot);
            let there = offset + data.len() as u32;
            assert_eq!(robot.ask(chunk), Ok(Answer::Received(there)));
        }
        let (answer, signature) = sign(robot, &key(1), 1, &blob);
        assert_eq!(answer, Ok(Answer::Done));
        // Between nonce and signature, and between request and answer.
        let (nonce, _) = challenge(robot);
        flood(robot);
        robot.exchange();
        let request = bytes_of(&Request::Commit(Swap::default()));
        let signature = key(1).sign(&access::command(&nonce, &signature, &request));
        let signed = Request::Signed {
            signature: &signature,
            request: &request,
        };
        let frame = robot.frame(signed);
        let number = robot.last_number();
        robot.wire.to_robot.extend(&frame);
        robot.exchange();
        flood(robot);
        let mut committed = Vec::new();
        for _ in 0..100 {
            committed.extend(robot.exchange());
            robot.world.pass_us(1_000);
            robot.timer();
        }
        let committed = committed.iter().find(|(seq, _)| *seq == number);
        assert!(
            matches!(committed, Some((_, Ok(Answer::Committed(_))))),
            "{committed:?}"
        );
        // Its answer was lost: it is not done again, whoever has asked for something meanwhile.
        flood(robot);
        robot.wire.to_robot.extend(&frame);
        let again = robot.exchange();
        let again = again.iter().find(|(seq, _)| *seq == number);
        assert!(
            matches!(again, Some((_, Ok(Answer::Committed(_))))),
            "{again:?}"
        );
    });
}

#[test]
fn what_an_owner_is_told_in_a_session_and_what_the_owner_signs_is_limited() {
    with_locked_robot(|robot| {
        let blob = counting(5).blob();
        robot.send(&blob);
        // An owner who was told a counter that is none does not use them up.
        for counter in [1 + MAX_COUNTER_STEP, u64::MAX] {
            let (refused, _) = sign(robot, &key(1), counter, &blob);
            assert_eq!(refused, Err(LinkError::CounterTooFar { last: 0 }));
        }
        let (signed, _) = sign(robot, &key(1), MAX_COUNTER_STEP, &blob);
        assert_eq!(signed, Ok(Answer::Done));
        // A signature is good for ten seconds of the robot's clock.
        let (nonce, _) = challenge(robot);
        let request = bytes_of(&Request::Start);
        let signature = key(1).sign(&access::command(&nonce, &NO_UPLOAD, &request));
        robot.run_us(NONCE_LIFE_US + 1);
        let signed = Request::Signed {
            signature: &signature,
            request: &request,
        };
        assert_eq!(robot.ask(signed), Err(LinkError::NoChallenge));
    });
}

/// A robot whose records are damaged, with what it remembers of its key.
fn with_damage(remembered: &[u8], test: impl FnOnce(&mut Bench<'_, '_, '_>)) {
    with_robot(|robot| {
        robot.wire.safe = Some(Safe {
            damaged: Some(remembered.to_vec()),
            ..Safe::default()
        });
        robot.run_us(100_000);
        test(robot);
    });
}

#[test]
fn a_robot_with_damaged_records_takes_a_key_of_its_owner_and_nothing_else() {
    let public = key(1).public().0;
    let record = [&public[..], &SALT, &key(1).secret(&SALT).0].concat();
    with_damage(&record, |robot| {
        assert_eq!(robot.access(), Access::Recovering);
        // Nobody but the owner.
        assert_eq!(install(robot, &key(2)), Err(LinkError::NeedsKey));
        let blob = counting(5).blob();
        let len = blob.len() as u32;
        let begin = Request::Begin { len, crc: 0 };
        assert_eq!(robot.ask(begin), Err(LinkError::NotStored));
        assert_eq!(robot.ask(Request::Start), Err(LinkError::NotStored));
        assert_eq!(robot.ask(Request::Stop), Ok(Answer::Done));
        // And of that one, nothing but a key.
        assert_eq!(robot.open_session(&key(1)), Ok(Answer::Done));
        assert_eq!(robot.ask(begin), Err(LinkError::NotStored));
        let start = ask_signed(robot, &key(1), &NO_UPLOAD, Request::Start);
        assert_eq!(start, Err(LinkError::NotStored));
        let forged = replacement(robot, &key(2), SALT);
        let forged = ask_signed(robot, &key(2), &NO_UPLOAD, forged.request());
        assert_eq!(forged, Err(LinkError::WrongSignature));
        pause(robot);
        let fresh = [9; SALT_BYTES];
        let again = replacement(robot, &key(1), fresh);
        let installed = ask_signed(robot, &key(1), &NO_UPLOAD, again.request());
        assert_eq!(installed, Ok(Answer::Done));
        robot.owner = None;
        assert_eq!(robot.access(), Access::Locked);
        // From then on all is as with a new key: what was signed for the salt before is of no use.
        assert_eq!(robot.open_session(&key(1)), Ok(Answer::Done));
        assert_eq!(challenge(robot).1, 0);
        robot.send(&blob);
        let (old, _) = sign(robot, &key(1), 1, &blob);
        assert_eq!(old, Err(LinkError::WrongSignature));
        pause(robot);
        robot.send(&blob);
        let signature = key(1).sign(&access::upload(&fresh, &1u64.to_le_bytes(), &blob));
        let signed = robot.ask(Request::Sign {
            counter: 1,
            signature: &signature,
        });
        assert_eq!(signed, Ok(Answer::Done));
    });
    with_damage(&[], |robot| {
        assert_eq!(robot.access(), Access::Damaged);
        assert_eq!(robot.ask(Request::Start), Err(LinkError::NotStored));
        assert_eq!(install(robot, &key(1)), Ok(Answer::Done));
        assert_eq!(robot.access(), Access::Locked);
        assert_eq!(robot.open_session(&key(1)), Ok(Answer::Done));
    });
    // A key that is not whole is none.
    with_damage(&record[1..], |robot| {
        assert_eq!(robot.access(), Access::Unreadable);
        assert_eq!(install(robot, &key(1)), Err(LinkError::NotStored));
    });
}
