//! USB, the other serial line of the link.
//!
//! Chips of the revisions B0 and B1 may not be found behind a hub with much traffic (RP2040-E5).
//! What the crate does about it takes GPIO 15, which may be a robot's, and is left out.

use cortex_m_board::usb_wire::{self, UsbWire};
use usb_device::device::UsbVidPid;

use crate::chip::USB_PRODUCT;
use crate::hal::usb::UsbBus;
use crate::slots::SlotBoard;

/// Vendor and product: the pair of Raspberry Pi for this chip where it is a serial port, which its
/// own SDK uses for any firmware. Systems know it as a serial port, and it needs no number of our
/// own; the texts tell what the device is. The numbers of pid.codes for tests may not leave a
/// laboratory.
pub(crate) const SERIAL_PORT: UsbVidPid = UsbVidPid(0x2E8A, USB_PRODUCT);

/// The device, for its interrupt handler.
pub type Usb = UsbWire<UsbBus>;
/// What it is made of.
pub type Device = usb_wire::Device<UsbBus>;

/// The board's.
///
/// # Panics
/// If it is taken again.
pub fn start(board: &mut SlotBoard) -> Usb {
    let Some(device) = board.board_mut().usb.take() else {
        panic!("USB is started once");
    };
    UsbWire(device)
}
