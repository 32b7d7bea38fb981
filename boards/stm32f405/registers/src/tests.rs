//! What each driver does to its registers, by the sections of the reference manual (RM0090).

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use embedded_hal::digital::{InputPin, OutputPin};
use embedded_hal::pwm::SetDutyCycle;
use embedded_storage::nor_flash::{NorFlash, NorFlashErrorKind, ReadNorFlash};
use rt_firmware::drivers::{AnalogIn, EchoPulse, EchoTimer, EncoderCounter};

use embedded_can::nb::Can;
use embedded_can::{ExtendedId, Frame, Id};

use crate::can_line::CanChip;
use crate::interrupt::is_masked;
use crate::mock::{Chip, Part, Plain};
use crate::on_chip_flash::OnChip;
use crate::pins::Function;
use crate::uart_dma::{OUT_BYTES, RING, RING_BYTES, TO_SEND, Uart};
use crate::wire::Wire;
use crate::{
    Stm32f405, analog, clock, encoders, motors, parts, sectors, sonars, uart_dma, usart, watchdog,
    wiring,
};

// Where parts begin: table 1.
const TIM2: usize = 0x4000_0000;
const TIM3: usize = 0x4000_0400;
const TIM4: usize = 0x4000_0800;
const TIM5: usize = 0x4000_0C00;
const TIM7: usize = 0x4000_1400;
const TIM12: usize = 0x4000_1800;
const CAN1: usize = 0x4000_6400;
const IWDG: usize = 0x4000_3000;
const TIM1: usize = 0x4001_0000;
const TIM8: usize = 0x4001_0400;
const USART1: usize = 0x4001_1000;
const ADC1: usize = 0x4001_2000;
const ADC_COMMON: usize = 0x4001_2300;
const GPIOA: usize = 0x4002_0000;
const GPIOB: usize = 0x4002_0400;
const GPIOC: usize = 0x4002_0800;
const RCC: usize = 0x4002_3800;
const FLASH: usize = 0x4002_3C00;
const DMA2: usize = 0x4002_6400;
// Of the core (PM0214, 4.5.6).
const SYST: usize = 0xE000_E010;
/// Interrupts that are made to come (PM0214, 4.3.4).
const ISPR: usize = 0xE000_E200;

// Registers of a general timer: 18.4.
const CR1: usize = 0x00;
const SMCR: usize = 0x08;
const DIER: usize = 0x0C;
const SR: usize = 0x10;
const EGR: usize = 0x14;
const CCMR1: usize = 0x18;
const CCMR2: usize = 0x1C;
const CCER: usize = 0x20;
const CNT: usize = 0x24;
const PSC: usize = 0x28;
const ARR: usize = 0x2C;
const CCR1: usize = 0x34;
// Of an advanced one: 17.4.
const BDTR: usize = 0x44;

// Registers of a port: 8.4.
const MODER: usize = 0x00;
const PUPDR: usize = 0x0C;
const IDR: usize = 0x10;
const BSRR: usize = 0x18;
const AFRL: usize = 0x20;
const AFRH: usize = 0x24;

// Of clocks and resets: 7.3.
const RCC_CR: usize = RCC;
const PLLCFGR: usize = RCC + 0x04;
const CFGR: usize = RCC + 0x08;
const AHB1ENR: usize = RCC + 0x30;
const APB1ENR: usize = RCC + 0x40;
const APB2ENR: usize = RCC + 0x44;

// Of the flash: 3.9.
const ACR: usize = FLASH;
const KEYR: usize = FLASH + 0x04;
const FLASH_SR: usize = FLASH + 0x0C;
const FLASH_CR: usize = FLASH + 0x10;

fn last(writes: &[(usize, u32)], at: usize) -> Option<u32> {
    let of = writes.iter().rev().find(|(to, _)| *to == at);
    of.map(|(_, word)| *word)
}

/// The place of the first write of this word there.
#[track_caller]
fn place(writes: &[(usize, u32)], at: usize, word: u32) -> usize {
    let found = writes.iter().position(|it| *it == (at, word));
    found.unwrap_or_else(|| panic!("no write of {word:#x} to {at:#x}: {writes:x?}"))
}

/// Oscillator, PLL and switch, which are ready when they are on, or never.
struct Oscillator {
    swings: bool,
}

impl Part for Oscillator {
    fn read(&mut self, at: usize, held: u32) -> u32 {
        match at {
            // HSEON, HSERDY; PLLON, PLLRDY.
            RCC_CR if self.swings => held | (held & 1 << 16) << 1 | (held & 1 << 24) << 1,
            // SW, SWS.
            CFGR => held & !0b1100 | (held & 0b11) << 2,
            _ => held,
        }
    }
}

#[test]
fn the_core_runs_at_168_mhz_from_a_crystal_of_8_mhz_7_3() {
    let mut chip = Chip::new(Oscillator { swings: true });
    clock::start();
    let writes = chip.writes();
    // 8 MHz / M × N / P = 8 / 8 × 336 / 2; Q = 7 for 48 MHz; bit 29 stays: 7.3.2.
    let pll = 1 << 29 | 7 << 24 | 1 << 22 | 336 << 6 | 8;
    assert_eq!(last(&writes, PLLCFGR), Some(pll));
    // Five wait states, caches and prefetch: table 10, 3.9.1.
    assert_eq!(last(&writes, ACR), Some(0b111 << 8 | 5));
    // APB1 by four, APB2 by two, the PLL: 7.3.3.
    let switched = 0b100 << 13 | 0b101 << 10 | 0b10;
    // The flash is slower before the core is faster.
    assert!(place(&writes, ACR, 0b111 << 8 | 5) < place(&writes, CFGR, switched));
    // SysTick counts 24 bits of the core's clock by eight, and calls nobody.
    assert_eq!(last(&writes, SYST + 4), Some(0xFF_FFFF));
    assert_eq!(last(&writes, SYST), Some(1));
}

#[test]
fn without_a_crystal_the_core_goes_on_as_it_began_7_3() {
    let mut chip = Chip::new(Oscillator { swings: false });
    clock::start();
    let writes = chip.writes();
    assert_eq!(last(&writes, PLLCFGR), None);
    assert_eq!(last(&writes, CFGR), None);
    // Time is counted all the same.
    assert_eq!(last(&writes, SYST), Some(1));
}

#[test]
fn the_watchdog_counts_half_a_second_21_4() {
    let mut chip = Chip::new(Plain);
    watchdog::start();
    let begun = [
        (IWDG, 0xCCCC),
        (IWDG, 0x5555),
        // By 16: 2 kHz of 32; 1,000 of them.
        (IWDG + 4, 2),
        (IWDG + 8, 1_000),
        (IWDG, 0xAAAA),
    ];
    assert_eq!(chip.writes(), begun);
    watchdog::feed();
    assert_eq!(chip.writes(), [(IWDG, 0xAAAA)]);
}

#[test]
fn a_pin_becomes_what_it_is_and_its_neighbours_stay_8_4() {
    let chip = Chip::new(Plain);
    // PA13 and PA14, at the debugger, with their pulls: the values after a reset.
    chip.set(GPIOA + MODER, 0xA800_0000);
    chip.set(GPIOA + PUPDR, 0x6400_0000);
    let [tx, rx] = wiring::LINK;
    tx.set_function(Function::PulledUpPart(7));
    rx.set_function(Function::Analog);
    assert_eq!(
        chip.word(GPIOA + MODER),
        0xA800_0000 | 0b10 << 18 | 0b11 << 20
    );
    assert_eq!(chip.word(GPIOA + PUPDR), 0x6400_0000 | 0b01 << 18);
    assert_eq!(chip.word(GPIOA + AFRH), 7 << 4);
    assert_eq!(chip.word(GPIOA + AFRL), 0);
}

#[test]
fn levels_are_set_and_read_by_single_bits_8_4() {
    let mut chip = Chip::new(Plain);
    let mut pin = wiring::STOP_BUTTON;
    pin.set_high().unwrap();
    pin.set_low().unwrap();
    assert_eq!(
        chip.writes(),
        [(GPIOC + BSRR, 1 << 5), (GPIOC + BSRR, 1 << (5 + 16))]
    );
    chip.set(GPIOC + IDR, 1 << 5);
    assert_eq!((pin.is_high(), pin.is_low()), (Ok(true), Ok(false)));
    chip.set(GPIOC + IDR, !(1 << 5));
    assert_eq!((pin.is_high(), pin.is_low()), (Ok(false), Ok(true)));
}

#[test]
fn encoders_count_each_edge_of_both_outputs_18_4() {
    let mut chip = Chip::new(Plain);
    let [mut left, mut right] = encoders::start();
    let writes = chip.writes();
    assert_eq!(last(&writes, APB1ENR), Some(0b110));
    for timer in [TIM3, TIM4] {
        // Inputs 1 and 2 by eight looks each; encoder mode 3; 16 bits.
        assert_eq!(last(&writes, timer + CCMR1), Some(0b0011_0001_0011_0001));
        assert_eq!(last(&writes, timer + SMCR), Some(0b011));
        assert_eq!(last(&writes, timer + ARR), Some(0xFFFF));
        assert_eq!(last(&writes, timer + CR1), Some(1));
    }
    // PA6, PA7, PB6, PB7: alternate function 2, pulled up.
    for port in [GPIOA, GPIOB] {
        assert_eq!(last(&writes, port + AFRL), Some(0x2200_0000));
        assert_eq!(last(&writes, port + MODER), Some(0b1010 << 12));
        assert_eq!(last(&writes, port + PUPDR), Some(0b0101 << 12));
    }
    // A wheel that turns backwards from 0.
    chip.set(TIM3 + CNT, 0xFFFF);
    chip.set(TIM4 + CNT, 7);
    assert_eq!((left.count(), right.count()), (0xFFFF, 7));
    assert_eq!(left.count().wrapping_sub(0) as i16, -1);
}

#[test]
fn motors_have_no_power_before_their_pins_are_theirs_17_4() {
    let mut chip = Chip::new(Plain);
    chip.set(TIM8 + CCR1, 4_000);
    let [(mut left, mut left_way), (mut right, mut right_way)] = motors::start();
    let writes = chip.writes();
    // 168 MHz / 20 kHz.
    assert_eq!(last(&writes, TIM8 + ARR), Some(8_399));
    // Four channels of PWM 1 whose duty is taken over with a period, all on, main output on.
    for mode in [CCMR1, CCMR2] {
        assert_eq!(last(&writes, TIM8 + mode), Some(0b0110_1000_0110_1000));
    }
    assert_eq!(last(&writes, TIM8 + CCER), Some(0x1111));
    assert_eq!(last(&writes, TIM8 + BDTR), Some(1 << 15));
    assert_eq!(last(&writes, TIM8 + EGR), Some(1));
    // PC6 to PC9: alternate function 3.
    assert_eq!(last(&writes, GPIOC + AFRL), Some(0x3300_0000));
    assert_eq!(last(&writes, GPIOC + AFRH), Some(0x0000_0033));
    let first_pin = writes
        .iter()
        .position(|(at, _)| *at == GPIOC + MODER)
        .unwrap();
    for channel in 0..4 {
        assert!(place(&writes, TIM8 + CCR1 + 4 * channel, 0) < first_pin);
    }
    assert!(place(&writes, TIM8 + EGR, 1) < first_pin);

    left_way.set_low().unwrap();
    right_way.set_high().unwrap();
    left.set_duty_cycle_percent(50).unwrap();
    right.set_duty_cycle_percent(25).unwrap();
    let duties = || [0, 1, 2, 3].map(|channel| chip.word(TIM8 + CCR1 + 4 * channel));
    assert_eq!(duties(), [4_200, 0, 0, 2_100]);
    // The other input is off before this one is on: never both, which would be a brake.
    left_way.set_high().unwrap();
    left.set_duty_cycle_fully_on().unwrap();
    assert_eq!(duties(), [0, 8_400, 0, 2_100]);
    motors::all_off();
    assert_eq!(duties(), [0; 4]);
    let reversed = chip.writes();
    assert!(place(&reversed, TIM8 + CCR1, 0) < place(&reversed, TIM8 + CCR1 + 4, 8_400));
}

/// Timers whose captured edges are forgotten when they are read, and a SysTick that runs.
struct Captures {
    ticks: u32,
}

impl Part for Captures {
    fn read(&mut self, at: usize, held: u32) -> u32 {
        if at == SYST + 8 {
            self.ticks = self.ticks.wrapping_sub(5) & 0xFF_FFFF;
            return self.ticks;
        }
        held
    }
}

/// Lets a timer have captured a time at a channel, from 0 on.
fn capture(chip: &Chip, timer: usize, channel: usize, us: u32) {
    chip.set(timer + CCR1 + 4 * channel, us);
    chip.set(timer + SR, chip.word(timer + SR) | 1 << (channel + 1));
}

#[test]
fn echoes_are_timed_to_a_microsecond_by_two_channels_each_18_4() {
    let mut chip = Chip::new(Captures { ticks: 1_000_000 });
    let (mut triggers, mut echoes) = sonars::start();
    let writes = chip.writes();
    // A count a microsecond, of 84 and of 168 MHz.
    assert_eq!(last(&writes, TIM5 + PSC), Some(83));
    assert_eq!(last(&writes, TIM1 + PSC), Some(167));
    // Channels 1 and 2 at input 1, 3 and 4 at input 3; of TIM1, 3 and 4 at input 4.
    let pair = 0b0011_0010_0011_0001;
    assert_eq!(last(&writes, TIM5 + CCMR1), Some(pair));
    assert_eq!(last(&writes, TIM5 + CCMR2), Some(pair));
    assert_eq!(last(&writes, TIM1 + CCMR1), Some(pair));
    assert_eq!(last(&writes, TIM1 + CCMR2), Some(0b0011_0001_0011_0010));
    for timer in [TIM5, TIM1] {
        // All on, the second of each pair for edges down.
        assert_eq!(last(&writes, timer + CCER), Some(0b0011_0001_0011_0001));
        assert_eq!(last(&writes, timer + CR1), Some(1));
    }

    // The trigger of sonar 0, PB0, is high for 10 µs and more: 210 ticks, 5 each look.
    triggers[0].set_high().unwrap();
    let accesses = chip.accesses();
    let at = |word| {
        let found = accesses
            .iter()
            .position(|it| it.is_write && it.word == word);
        found.unwrap()
    };
    let (up, down) = (at(1), at(1 << 16));
    let looks = accesses[up..down].iter().filter(|it| it.at == SYST + 8);
    assert!(looks.count() >= 210 / 5, "{up} {down}");

    assert_eq!(echoes[0].pulse(), EchoPulse::None);
    capture(&chip, TIM5, 0, 65_000);
    chip.set(TIM5 + CNT, 65_500);
    assert_eq!(echoes[0].pulse(), EchoPulse::High { us: 500 });
    // The timer wraps in between.
    capture(&chip, TIM5, 1, 464);
    assert_eq!(echoes[0].pulse(), EchoPulse::Over { us: 1_000 });
    // The neighbour at the same pin has not pinged.
    assert_eq!(echoes[1].pulse(), EchoPulse::None);
    // Sonar 6 is at channels 3 and 4 of TIM1, of which 4 has the edges up of the input.
    triggers[6].set_high().unwrap();
    chip.set(TIM1 + SR, 0);
    assert_eq!(echoes[6].pulse(), EchoPulse::None);
}

/// A converter that has done when it was started, and says which channel it was; or never.
struct Converter {
    works: bool,
    channel: u32,
}

impl Part for Converter {
    fn write(&mut self, at: usize, _before: u32, written: u32) -> u32 {
        const SQR3: usize = ADC1 + 0x34;
        match at {
            SQR3 => self.channel = written,
            // SWSTART is taken back by the part.
            at if at == ADC1 + 8 => return written & !(1 << 30),
            _ => {}
        }
        written
    }

    fn read(&mut self, at: usize, held: u32) -> u32 {
        match at {
            ADC1 if self.works => held | 1 << 1,
            at if at == ADC1 + 0x4C => 100 * self.channel,
            _ => held,
        }
    }
}

#[test]
fn a_conversion_is_of_the_channel_of_its_pin_13_13() {
    let mut chip = Chip::new(Converter {
        works: true,
        channel: 0,
    });
    let mut inputs = analog::start();
    let writes = chip.writes();
    // 84 MHz by four; 84 cycles for each channel from 10 on; on.
    assert_eq!(last(&writes, ADC_COMMON + 4), Some(0b01 << 16));
    assert_eq!(last(&writes, ADC1 + 0x0C), Some(0o444_444_444));
    assert_eq!(last(&writes, ADC1 + 8), Some(1));
    // PC0 to PC3 are analogue.
    assert_eq!(last(&writes, GPIOC + MODER), Some(0xFF));
    for (input, channel) in inputs.iter_mut().zip([10, 11, 12, 13]) {
        assert_eq!(input.counts(), 100 * channel);
        assert_eq!(last(&chip.writes(), ADC1 + 8), Some(1 << 30 | 1));
    }
}

#[test]
fn a_converter_that_never_ends_holds_nobody_up_13_13() {
    let _chip = Chip::new(Converter {
        works: false,
        channel: 0,
    });
    let [mut battery, ..] = analog::start();
    battery.counts();
}

/// A flash whose operations take some looks, and fail where they are to.
struct Controller {
    /// Looks until the operation is done.
    busy_looks: u32,
    left: u32,
    /// What the status says then.
    fails_with: u32,
    was_unmasked: Arc<AtomicBool>,
}

impl Part for Controller {
    fn write(&mut self, at: usize, before: u32, written: u32) -> u32 {
        match at {
            // Flags are taken back by ones: 3.9.5.
            FLASH_SR => before & !written,
            FLASH_CR if written & 1 << 16 != 0 || written & 1 != 0 => {
                self.left = self.busy_looks;
                if !is_masked() {
                    self.was_unmasked.store(true, Relaxed);
                }
                written
            }
            _ => written,
        }
    }

    fn read(&mut self, at: usize, held: u32) -> u32 {
        if at != FLASH_SR {
            return held;
        }
        if self.left > 0 {
            self.left -= 1;
            return 1 << 16;
        }
        self.fails_with
    }
}

fn flash(fails_with: u32) -> (Chip, Arc<AtomicBool>) {
    let was_unmasked = Arc::default();
    let chip = Chip::new(Controller {
        busy_looks: 50,
        left: 0,
        fails_with,
        was_unmasked: Arc::clone(&was_unmasked),
    });
    (chip, was_unmasked)
}

type Store = OnChip<sectors::Sectors>;

#[test]
fn a_sector_is_erased_behind_the_keys_and_the_watchdog_is_fed_3_6() {
    let (mut chip, was_unmasked) = flash(0);
    let mut store = Store::new();
    // The second sector of the store: sector 7.
    assert_eq!(store.erase(128 << 10, 256 << 10), Ok(()));
    let writes = chip.writes();
    let of_control: Vec<_> = writes
        .iter()
        .filter(|it| it.0 == KEYR || it.0 == FLASH_CR)
        .collect();
    // SER, SNB, by words: 3.9.6. STRT when all is said.
    let erase = 0b10 << 8 | 7 << 3 | 1 << 1;
    assert_eq!(
        of_control,
        [
            &(KEYR, 0x4567_0123),
            &(KEYR, 0xCDEF_89AB),
            &(FLASH_CR, erase),
            &(FLASH_CR, erase | 1 << 16),
            &(FLASH_CR, 1 << 31),
        ]
    );
    let fed = writes.iter().filter(|it| **it == (IWDG, 0xAAAA)).count();
    assert!(fed >= 49, "{fed}");
    // What the data cache has is forgotten: off, reset, on.
    let cache: Vec<u32> = writes
        .iter()
        .filter(|it| it.0 == ACR)
        .map(|it| it.1 >> 10 & 0b101)
        .collect();
    assert_eq!(cache, [0b000, 0b100, 0b000, 0b001]);
    assert!(
        !was_unmasked.load(Relaxed),
        "a slot could have given a motor power"
    );
    assert!(!is_masked());
}

#[test]
fn words_are_written_one_by_one_and_read_back_3_6() {
    let (mut chip, _) = flash(0);
    let mut store = Store::new();
    let bytes: Vec<u8> = (0..64).collect();
    assert_eq!(store.write(4_096, &bytes), Ok(()));
    let begun = chip
        .writes()
        .into_iter()
        .filter(|it| *it == (FLASH_CR, 0b10 << 8 | 1));
    // Told before it begins, and when it begins.
    assert_eq!(begun.count(), 2 * 64 / 4);
    let mut read = [0; 64];
    assert_eq!(store.read(4_096, &mut read), Ok(()));
    assert_eq!(read.as_slice(), bytes);
    assert_eq!(
        store.write(4_097, &bytes),
        Err(NorFlashErrorKind::NotAligned)
    );
    assert_eq!(store.capacity(), 768 << 10);
}

#[test]
fn what_the_flash_refuses_is_told_3_9_5() {
    // Write protection, alignment, parallelism, sequence; and an operation that failed.
    for flag in [1, 4, 5, 6, 7] {
        let (mut chip, _) = flash(1 << flag);
        assert_eq!(
            Store::new().erase(0, 128 << 10),
            Err(NorFlashErrorKind::Other)
        );
        // It is locked all the same.
        assert_eq!(last(&chip.writes(), FLASH_CR), Some(1 << 31));
    }
}

#[test]
fn nothing_is_erased_while_a_motor_has_power() {
    let (mut chip, _) = flash(0);
    for channel in 0..4 {
        chip.set(TIM8 + CCR1 + 4 * channel, 1);
        assert_eq!(
            Store::new().erase(0, 128 << 10),
            Err(NorFlashErrorKind::Other)
        );
        assert_eq!(
            Store::new().write(0, &[0; 4]),
            Err(NorFlashErrorKind::Other)
        );
        chip.set(TIM8 + CCR1 + 4 * channel, 0);
    }
    assert_eq!(chip.writes(), []);
}

/// A USART whose last byte is out, and streams whose transfers end when the test says so.
struct Silence;

impl Part for Silence {
    fn read(&mut self, at: usize, held: u32) -> u32 {
        match at {
            USART1 => held | 1 << 6,
            _ => held,
        }
    }
}

/// Stream `n`'s registers: 10.5.
const fn stream(n: usize) -> usize {
    DMA2 + 0x10 + 0x18 * n
}
const NDTR: usize = 0x04;
const PAR: usize = 0x08;
const M0AR: usize = 0x0C;

/// A line that has started, and has taken nothing.
fn line() -> (Chip, Uart) {
    let mut chip = Chip::new(Silence);
    uart_dma::start();
    chip.accesses();
    let mut uart = Uart;
    while uart.receive().is_some() {}
    (chip, uart)
}

/// Bytes come in: DMA writes them behind those before.
fn come(chip: &Chip, bytes: &[u8]) {
    for byte in bytes {
        let left = chip.word(stream(2) + NDTR) as usize;
        RING[RING_BYTES - left].store(*byte, Relaxed);
        let left = if left == 1 { RING_BYTES } else { left - 1 };
        chip.set(stream(2) + NDTR, left as u32);
    }
}

#[test]
fn dma_writes_what_comes_into_a_ring_10_5() {
    let mut chip = Chip::new(Plain);
    uart_dma::start();
    let writes = chip.writes();
    // Channel 4, memory counts up, over and over, from the part; on at the end.
    let control = 4 << 25 | 1 << 10 | 1 << 8 | 1;
    let begun = place(&writes, stream(2), control);
    for (at, word) in [
        (NDTR, 256),
        (PAR, USART1 as u32 + 4),
        (M0AR, RING.as_ptr() as u32),
    ] {
        assert!(place(&writes, stream(2) + at, word) < begun);
    }
    // Both directions by DMA; part, transmitter, receiver: 30.6. No interrupt of its own.
    assert_eq!(last(&writes, USART1 + 0x14), Some(0b11 << 6));
    assert_eq!(
        last(&writes, USART1 + 0x0C),
        Some(1 << 13 | 1 << 3 | 1 << 2)
    );
    // 84 MHz / 115,200 = 729, which is 0.02 % too fast.
    assert_eq!(last(&writes, USART1 + 0x08), Some(729));
    // The line is looked at each 500 µs: 84 MHz / 84 / 500.
    assert_eq!(last(&writes, TIM7 + PSC), Some(83));
    assert_eq!(last(&writes, TIM7 + ARR), Some(499));
    assert_eq!(last(&writes, TIM7 + DIER), Some(1));
    assert_eq!(last(&writes, AHB1ENR).map(|it| it >> 22 & 1), Some(1));
    // PA9 and PA10: alternate function 7, pulled up.
    assert_eq!(last(&writes, GPIOA + AFRH), Some(0x770));
}

#[test]
fn bytes_come_in_their_order_around_the_ring() {
    let (chip, mut uart) = line();
    assert!(!uart.has_received());
    let mut number = 0_u8;
    for length in [1, 100, 255, 200, 256 - 44, 3] {
        let bytes: Vec<u8> = (0..length)
            .map(|_| {
                number = number.wrapping_add(7);
                number
            })
            .collect();
        come(&chip, &bytes);
        let taken: Vec<u8> = std::iter::from_fn(|| uart.receive()).collect();
        assert_eq!(taken, bytes);
    }
}

#[test]
fn what_is_sent_goes_out_as_one_transfer_and_the_next_waits_10_5() {
    let (mut chip, mut uart) = line();
    for byte in b"motors off" {
        assert!(uart.can_send());
        uart.send(*byte);
    }
    assert!(chip.writes().is_empty());
    uart.want_sent(false);
    let sent: Vec<u8> = TO_SEND[..10].iter().map(|it| it.load(Relaxed)).collect();
    assert_eq!(sent, b"motors off");
    let writes = chip.writes();
    // Flags of stream 7 first, and the part's own that all is out.
    assert_eq!(last(&writes, DMA2 + 0x0C), Some(0x0F40_0000));
    assert_eq!(last(&writes, USART1).map(|it| it & 1 << 6), Some(0));
    let begun = place(&writes, stream(7), 4 << 25 | 1 << 10 | 0b01 << 6 | 1);
    assert!(place(&writes, stream(7) + NDTR, 10) < begun);
    assert!(place(&writes, stream(7) + M0AR, TO_SEND.as_ptr() as u32) < begun);
    // It is under way.
    assert!(!uart.can_send() && !uart.is_silent());
    uart.want_sent(true);
    assert!(chip.writes().is_empty());
    // The stream ends itself.
    chip.set(stream(7), 0);
    assert!(uart.is_silent());
    for byte in 0..OUT_BYTES as u8 {
        assert!(uart.can_send());
        uart.send(byte);
    }
    assert!(!uart.can_send());
}

#[test]
fn rates_are_divisors_of_the_bus_30_6() {
    let mut chip = Chip::new(Plain);
    for (baud, divisor) in [
        (9_600, 8_750),
        (57_600, 1_458),
        (230_400, 365),
        (921_600, 91),
    ] {
        usart::set_rate(baud);
        assert_eq!(last(&chip.writes(), USART1 + 0x08), Some(divisor));
    }
}

#[test]
fn all_that_is_at_the_pins_starts_and_no_pin_has_two_parts() {
    let chip = Chip::new(Converter {
        works: true,
        channel: 0,
    });
    let (mut button, _) = parts::start();
    let all = [wiring::STOP_BUTTON]
        .into_iter()
        .chain(wiring::LINK)
        .chain(wiring::CAN)
        .chain(wiring::MOTORS)
        .chain(wiring::LEFT_ENCODER)
        .chain(wiring::RIGHT_ENCODER)
        .chain(wiring::TRIGGERS)
        .chain(wiring::ECHOES)
        .chain(wiring::ANALOG);
    let mut pins: Vec<(usize, u8)> = all.map(|pin| (pin.port as usize, pin.number)).collect();
    let count = pins.len();
    pins.sort_unstable();
    pins.dedup();
    assert_eq!(pins.len(), count);
    // The button is an input that is pulled up: not pressed while nobody pulls it down.
    assert_eq!(chip.word(GPIOC + PUPDR) >> 10 & 0b11, 0b01);
    chip.set(GPIOC + IDR, 1 << 5);
    assert_eq!(button.is_low(), Ok(false));
    // Clocks of the timers 3, 4 and 5, of 1 and 8, and of the converter.
    assert_eq!(chip.word(APB1ENR), 0b1110);
    assert_eq!(chip.word(APB2ENR), 1 << 8 | 0b11);
    assert_eq!(chip.word(TIM2 + CR1), 0);
}

// Of the controller: 32.9.
const MCR: usize = CAN1;
const MSR: usize = CAN1 + 0x04;
const TSR: usize = CAN1 + 0x08;
const RF0R: usize = CAN1 + 0x0C;
const IER: usize = CAN1 + 0x14;
const BTR: usize = CAN1 + 0x1C;
const TI0R: usize = CAN1 + 0x180;
const TDT0R: usize = CAN1 + 0x184;
const TDL0R: usize = CAN1 + 0x188;
const RI0R: usize = CAN1 + 0x1B0;

/// A controller with empty mailboxes, whose mode is what was asked for as long as it has a clock.
struct Bus {
    has_clock: Arc<AtomicBool>,
    mode: u32,
    /// A bit for each mailbox.
    empty: u32,
}

impl Part for Bus {
    fn read(&mut self, at: usize, held: u32) -> u32 {
        match at {
            // INAK and SLAK follow INRQ and SLEEP: 32.4.
            MSR if self.has_clock.load(Relaxed) => self.mode & 0b11,
            TSR => held | self.empty << 26,
            _ => held,
        }
    }

    fn write(&mut self, at: usize, before: u32, written: u32) -> u32 {
        match at {
            MCR => self.mode = written,
            // RFOM gives the place of a frame free, and FOVR is taken back by a one: 32.9.2.
            RF0R if written & 1 << 5 != 0 => return before & !0b11,
            RF0R => return before & !(written & 1 << 4),
            // TXRQ: the mailbox is full.
            TI0R if written & 1 != 0 => self.empty &= !1,
            _ => {}
        }
        written
    }
}

/// A chip whose controller can be set up, and what takes its clock away.
fn can_bus() -> (Chip, Arc<AtomicBool>) {
    let has_clock = Arc::new(AtomicBool::new(true));
    let chip = Chip::new(Bus {
        has_clock: Arc::clone(&has_clock),
        mode: 0b10,
        empty: 0b111,
    });
    // As a reset leaves it: 14 of the filters are of CAN 1 (32.9.4).
    chip.set(CAN1 + 0x200, 0x2A1C_0E01);
    (chip, has_clock)
}

#[test]
fn can_takes_all_frames_and_starts_without_waiting_for_the_bus_32_7() {
    let (mut chip, _) = can_bus();
    let mut can = <Stm32f405 as CanChip>::start();
    let writes = chip.writes();
    // CAN 1 and timer 12.
    assert_eq!(last(&writes, APB1ENR), Some(1 << 25 | 1 << 6));
    // PB8, PB9: alternate function 9, pulled up.
    assert_eq!(last(&writes, GPIOB + AFRH), Some(0x99));
    // A filter of 32 bits that masks nothing, for FIFO 0: 32.9.4.
    assert_eq!(last(&writes, CAN1 + 0x20C), Some(1));
    assert_eq!(last(&writes, CAN1 + 0x21C), Some(1));
    assert_eq!(last(&writes, CAN1 + 0x214), Some(0));
    // What has come calls.
    assert_eq!(last(&writes, IER), Some(1 << 1));
    // Timer 12 counts as the clock does: 84 MHz by four.
    assert_eq!(last(&writes, TIM12 + PSC), Some(3));
    assert_eq!(last(&writes, TIM12 + DIER), Some(1));

    // 42 MHz / (1 + 11 + 2): looked at behind 86 % of a bit.
    for (rate_bps, divisor) in [(1_000_000, 3), (500_000, 6), (250_000, 12), (125_000, 24)] {
        <Stm32f405 as CanChip>::set_rate(&mut can, rate_bps);
        let writes = chip.writes();
        assert_eq!(last(&writes, BTR), Some(1 << 20 | 10 << 16 | (divisor - 1)));
        // Neither initialisation nor sleep; back by itself after it was off the bus (ABOM).
        assert_eq!(last(&writes, MCR).map(|it| it & 0b100_0011), Some(1 << 6));
    }
}

#[test]
fn a_controller_without_a_clock_holds_nobody_up() {
    let (chip, has_clock) = can_bus();
    let mut can = <Stm32f405 as CanChip>::start();
    has_clock.store(false, Relaxed);
    chip.set(BTR, 7);
    <Stm32f405 as CanChip>::set_rate(&mut can, 500_000);
    assert_eq!(chip.word(BTR), 7);
}

#[test]
fn frames_go_into_mailboxes_and_come_out_of_the_fifo_32_7() {
    let (mut chip, _) = can_bus();
    let mut can = <Stm32f405 as CanChip>::start();
    chip.accesses();
    let id = ExtendedId::new(0x1234_5678).unwrap();
    let frame = <bxcan::Frame as Frame>::new(id, &[1, 2, 3, 4, 5]).unwrap();
    assert!(matches!(Can::transmit(&mut can, &frame), Ok(None)));
    let writes = chip.writes();
    // An identifier of 29 bits; TXRQ when all is there: 32.9.3.
    let begun = place(&writes, TI0R, 0x1234_5678 << 3 | 1 << 2 | 1);
    assert!(place(&writes, TDL0R, 0x0403_0201) < begun);
    assert_eq!(chip.word(TDT0R) & 0xF, 5);

    chip.set(RI0R, 0x0ABC_DEF0 << 3 | 1 << 2);
    chip.set(RI0R + 4, 2);
    chip.set(RI0R + 8, 0x0000_BBAA);
    assert!(Can::receive(&mut can).is_err());
    chip.set(RF0R, 1);
    let heard = Can::receive(&mut can).unwrap();
    assert_eq!(
        Frame::id(&heard),
        Id::Extended(ExtendedId::new(0x0ABC_DEF0).unwrap())
    );
    assert_eq!(Frame::data(&heard), [0xAA, 0xBB]);
    // Its place is free.
    assert!(matches!(Can::receive(&mut can), Err(nb::Error::WouldBlock)));
    // One that found no place is told of.
    chip.set(RF0R, 1 | 1 << 4);
    assert!(matches!(Can::receive(&mut can), Err(nb::Error::Other(_))));
}

#[test]
fn a_frame_s_timer_counts_16_bits_once_19_4() {
    let mut chip = Chip::new(Plain);
    for (ticks, end) in [
        (2_100, 2_099),
        (0, 0),
        (65_536, 65_535),
        (1_000_000, 65_535),
    ] {
        <Stm32f405 as CanChip>::set_timer(ticks);
        let writes = chip.writes();
        assert_eq!(last(&writes, TIM12 + ARR), Some(end));
        // Only the counter's own update calls; begun anew, then one pulse.
        let begun = place(&writes, TIM12 + CR1, 1 << 2);
        let anew = place(&writes, TIM12 + EGR, 1);
        assert!(begun < anew && anew < place(&writes, TIM12 + CR1, 1 << 3 | 1 << 2 | 1));
    }
    <Stm32f405 as CanChip>::call();
    // Interrupt 43.
    assert_eq!(chip.writes(), [(ISPR + 4, 1 << (43 - 32))]);
}
