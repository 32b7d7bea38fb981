//! USB, the other serial line of the link: a CDC device, so that the robot is a serial port of the
//! computer that it is plugged into, without an adapter.
//!
//! [`line`](crate::line) has the queues around it. Nothing here waits for the host: what it does
//! not fetch stays in two packets and in the queue of the line, and the link sends no more until
//! there is room. Where nobody has the bus configured, the packet is dropped.
//!
//! Chips of the revisions B0 and B1 may not be found behind a hub with much traffic (RP2040-E5).
//! What the crate does about it takes GPIO 15, which is a sonar's trigger, and is left out.

use cortex_m_board::line::Wire;
use heapless::Vec;
use rp2040_hal::usb::UsbBus;
use usb_device::bus::UsbBusAllocator;
use usb_device::device::{
    StringDescriptors, UsbDevice, UsbDeviceBuilder, UsbDeviceState, UsbVidPid,
};
use usbd_serial::{CdcAcmClass, USB_CLASS_CDC};

use crate::line::Speaker;

/// Vendor and product: the pair of Raspberry Pi for an RP2040 that is a serial port, which its own
/// SDK uses for any firmware. Systems know it as a serial port, and it needs no number of our own;
/// the texts tell what the device is. The numbers of pid.codes for tests may not leave a
/// laboratory.
const SERIAL_PORT: UsbVidPid = UsbVidPid(0x2E8A, 0x000A);
/// Who makes it.
pub const MAKER: &str = "esm";
/// What it is.
pub const PRODUCT: &str = "esm robot on pico";

/// Bytes that a packet may have.
const PACKET_BYTES: usize = 64;
/// Bytes of a packet to the host. A packet that is not full ends a transfer: so the host hands on
/// each as it comes, and none needs an empty one behind it.
const SENT_BYTES: usize = PACKET_BYTES - 1;

/// The device, for its interrupt handler.
pub struct Usb {
    device: UsbDevice<'static, UsbBus>,
    serial: CdcAcmClass<'static, UsbBus>,
    /// A packet from the host, and how many of its bytes were taken.
    received: Vec<u8, PACKET_BYTES>,
    taken: usize,
    /// The next packet to the host.
    to_send: Vec<u8, SENT_BYTES>,
}

impl Usb {
    /// The device on this bus, or `None` if its texts are too long.
    pub(crate) fn new(bus: &'static UsbBusAllocator<UsbBus>) -> Option<Self> {
        let serial = CdcAcmClass::new(bus, PACKET_BYTES as u16);
        let texts = StringDescriptors::default()
            .manufacturer(MAKER)
            .product(PRODUCT);
        let device = UsbDeviceBuilder::new(bus, SERIAL_PORT)
            .strings(&[texts])
            .ok()?
            .device_class(USB_CLASS_CDC)
            .max_packet_size_0(PACKET_BYTES as u8)
            .ok()?
            .build();
        Some(Self {
            device,
            serial,
            received: Vec::new(),
            taken: 0,
            to_send: Vec::new(),
        })
    }

    /// Gives the next packet to the bus, if the one before has left.
    fn flush(&mut self) {
        if !self.to_send.is_empty() && self.serial.write_packet(&self.to_send).is_ok() {
            self.to_send.clear();
        }
    }
}

impl Wire for Usb {
    const FIFO_BYTES: usize = PACKET_BYTES;

    fn acknowledge(&mut self) {
        self.device.poll(&mut [&mut self.serial]);
        if self.device.state() != UsbDeviceState::Configured {
            // It was for a host that is gone.
            self.to_send.clear();
        }
    }

    fn has_received(&mut self) -> bool {
        if self.taken == self.received.len() {
            self.taken = 0;
            self.received.clear();
            let mut packet = [0; PACKET_BYTES];
            if let Ok(count) = self.serial.read_packet(&mut packet) {
                // A packet fits.
                let _ = self
                    .received
                    .extend_from_slice(packet.get(..count).unwrap_or_default());
            }
        }
        self.taken < self.received.len()
    }

    fn receive(&mut self) -> Option<u8> {
        if !self.has_received() {
            return None;
        }
        Speaker::Usb.speaks();
        let byte = self.received.get(self.taken).copied();
        self.taken += 1;
        byte
    }

    fn can_send(&mut self) -> bool {
        Speaker::Usb.is_answered()
            && self.device.state() == UsbDeviceState::Configured
            && !self.to_send.is_full()
    }

    fn send(&mut self, byte: u8) {
        // There is room: see `can_send`.
        let _ = self.to_send.push(byte);
    }

    /// The interrupt comes for each packet that has left, whether or not it is wanted.
    fn want_sent(&mut self, _sent: bool) {
        self.flush();
    }
}
