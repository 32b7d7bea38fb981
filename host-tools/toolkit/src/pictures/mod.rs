//! Pictures: the path of a run over the map, its states over time, and the slots of a schedule.
//!
//! What a picture shows is worked out once, as a [`scene::Scene`]: shapes and words at places. From
//! that one description come the SVG and the PNG, so that both say the same. The PNG's letters are
//! drawn from an embedded font, the SVG's from the reader's, which is asked to keep their widths.
//! Equal input gives equal bytes, on every machine.
//!
//! ```
//! use esm_toolkit::pictures::{Leg, PathPicture, PathSample};
//!
//! let sample = |t_us, x_m, y_m| PathSample { t_us, x_m, y_m };
//! let picture = PathPicture {
//!     title: "patrol".into(),
//!     walls: vec![[[0.0, 0.0], [4.0, 0.0]], [[4.0, 0.0], [4.0, 3.0]]],
//!     legs: vec![Leg { name: "patrol".into(), samples: vec![sample(0, 1.0, 1.0), sample(1_000_000, 2.0, 1.5)] }],
//!     ..PathPicture::default()
//! };
//! let scene = picture.scene();
//! assert!(scene.to_svg().starts_with("<svg"));
//! assert!(scene.to_png().is_ok_and(|png| png.starts_with(b"\x89PNG")));
//! ```

pub mod axis;
pub(crate) mod bars;
mod curves;
mod drive;
pub mod font;
pub(crate) mod palette;
mod path;
mod png;
mod recorder;
pub mod scene;
mod slots;
mod svg;
mod timeline;

pub use curves::{Curve, Curves, Panel};
pub use drive::DrivePicture;
pub use path::{FloorLine, Leg, PathPicture, PathSample, Person, Room};
pub use png::PngError;
pub use recorder::StatesRecorder;
pub use slots::{MAX_FRAMES, MAX_ROWS, SlotPicture};
pub use timeline::{Mark, MissionStates, RegionStates, StateSpan, Timeline};

#[cfg(test)]
mod samples;

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn assert_golden(name: &str, found: &[u8]) {
        crate::test_golden::assert_golden(Path::new("src/pictures/golden").join(name), found);
    }

    #[test]
    fn a_path_over_a_map_looks_as_it_did() {
        let scene = samples::flat().scene();
        assert_golden("path.svg", scene.to_svg().as_bytes());
        assert_golden("path.png", &scene.to_png().unwrap());
    }

    #[test]
    fn people_on_a_map_look_as_they_did() {
        let scene = samples::visited().scene();
        assert_golden("people.svg", scene.to_svg().as_bytes());
        assert_golden("people.png", &scene.to_png().unwrap());
    }

    #[test]
    fn states_over_time_look_as_they_did() {
        let scene = samples::two_minutes().scene();
        assert_golden("states.svg", scene.to_svg().as_bytes());
        assert_golden("states.png", &scene.to_png().unwrap());
    }

    #[test]
    fn schedules_look_as_they_did() {
        for (name, picture) in [
            ("slots", samples::four_slots()),
            ("slots_many", samples::thirty_slots()),
        ] {
            let scene = picture.scene();
            assert_golden(&format!("{name}.svg"), scene.to_svg().as_bytes());
            assert_golden(&format!("{name}.png"), &scene.to_png().unwrap());
        }
    }

    #[test]
    fn pictures_of_next_to_nothing_are_pictures() {
        let lonely = PathPicture {
            legs: vec![Leg {
                name: "none".into(),
                samples: vec![PathSample {
                    t_us: 5,
                    x_m: f32::NAN,
                    y_m: 0.0,
                }],
            }],
            ..PathPicture::default()
        };
        for scene in [
            PathPicture::default().scene(),
            lonely.scene(),
            Timeline::default().scene(),
        ] {
            assert!(scene.width.is_finite() && scene.height.is_finite());
            assert!(!scene.to_svg().contains("NaN"), "{}", scene.to_svg());
            assert!(scene.to_png().is_ok());
        }
    }

    #[test]
    fn a_long_run_of_fast_changes_stays_a_small_picture() {
        let flicker: Vec<(&str, u64)> = (0..100_000)
            .map(|tick| (if tick % 2 == 0 { "A" } else { "B" }, 1))
            .collect();
        let regions = vec![RegionStates {
            path: "motion".into(),
            spans: samples::spans(0, &flicker),
        }];
        let mission = MissionStates {
            name: "flicker".into(),
            start_us: 0,
            end_us: 100_000_000,
            regions,
        };
        let timeline = Timeline {
            missions: vec![mission],
            ..Timeline::default()
        };
        assert!(timeline.scene().to_svg().len() < 400_000);
    }
}
