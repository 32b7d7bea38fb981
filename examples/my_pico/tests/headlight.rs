//! The task by itself, on a bench, with a pin image as its hardware.

use esm::rt_firmware::TaskBench;
use esm::rt_firmware::body::{AuxOutput, PinImage};
use esm::rt_firmware::tasks::Ranges;

use my_pico::headlight::Headlight;
use my_pico::lamp::Lamp;

type Light<'a> = Headlight<AuxOutput<'a>>;

#[test]
fn the_lamp_is_lit_while_something_is_near_and_does_not_flicker() {
    let pins = PinImage::new();
    let [pin, ..] = pins.parts().aux_outputs;
    let mut bench = TaskBench::new(Headlight::new(Lamp::new(pin)));
    bench.param(Light::NEAR_M, 0.6);
    for (ahead_m, lit) in [
        (2.0, false),
        (0.59, true),
        (0.61, true),
        (0.74, true),
        (0.76, false),
        (0.61, false),
    ] {
        let mut ranges = Ranges::FREE;
        ranges.range_m[0] = ahead_m;
        bench.give(Light::RANGES, ranges);
        bench.step();
        assert_eq!(bench.flag(Light::LIT), lit, "at {ahead_m} m");
        assert_eq!(
            pins.take_actuators().aux_outputs,
            u8::from(lit),
            "at {ahead_m} m"
        );
    }
}
