//! USB, the other serial line of the link: a CDC device, so that the robot is a serial port of the
//! computer that it is plugged into, without an adapter.
//!
//! [`line`](crate::line) has the queues around it.

use cortex_m_board::line::Wire;
use rp2040_hal::usb::UsbBus;
use usb_device::bus::UsbBusAllocator;
use usb_device::device::{StringDescriptors, UsbDevice, UsbDeviceBuilder, UsbVidPid};
use usbd_serial::{SerialPort, USB_CLASS_CDC};

use crate::line;

/// Vendor and product: the pair that V-USB shares for CDC devices, which are told apart by the texts
/// of maker and product.
const SHARED_CDC: UsbVidPid = UsbVidPid(0x16C0, 0x27DD);
/// Who makes it.
pub const MAKER: &str = "esm";
/// What it is.
pub const PRODUCT: &str = "esm robot on pico";

/// Bytes of a packet.
const PACKET_BYTES: usize = 64;

/// The device, for its interrupt handler.
pub struct Usb {
    device: UsbDevice<'static, UsbBus>,
    serial: SerialPort<'static, UsbBus>,
    packet: [u8; PACKET_BYTES],
    /// How many bytes of the packet were taken, and how many it has.
    taken: usize,
    received: usize,
    /// A byte that found no room.
    unsent: Option<u8>,
}

impl Usb {
    /// The device on this bus.
    pub(crate) fn new(bus: &'static UsbBusAllocator<UsbBus>) -> Option<Self> {
        let serial = SerialPort::new(bus);
        let texts = StringDescriptors::default()
            .manufacturer(MAKER)
            .product(PRODUCT);
        let device = UsbDeviceBuilder::new(bus, SHARED_CDC)
            .strings(&[texts])
            .ok()?
            .device_class(USB_CLASS_CDC)
            .max_packet_size_0(PACKET_BYTES as u8)
            .ok()?
            .build();
        Some(Self {
            device,
            serial,
            packet: [0; PACKET_BYTES],
            taken: 0,
            received: 0,
            unsent: None,
        })
    }

    /// Sends what found no room before. True if nothing waits.
    fn catch_up(&mut self) -> bool {
        if let Some(byte) = self.unsent.take() {
            self.send(byte);
        }
        self.unsent.is_none()
    }
}

impl Wire for Usb {
    const FIFO_BYTES: usize = PACKET_BYTES;

    fn acknowledge(&mut self) {
        self.device.poll(&mut [&mut self.serial]);
    }

    fn has_received(&mut self) -> bool {
        if self.taken == self.received {
            self.taken = 0;
            self.received = self.serial.read(&mut self.packet).unwrap_or(0);
        }
        self.taken < self.received
    }

    fn receive(&mut self) -> Option<u8> {
        if !self.has_received() {
            return None;
        }
        line::spoken_by(line::Speaker::Usb);
        let byte = self.packet.get(self.taken).copied();
        self.taken += 1;
        byte
    }

    fn can_send(&mut self) -> bool {
        line::answers(line::Speaker::Usb) && self.catch_up()
    }

    fn send(&mut self, byte: u8) {
        if !matches!(self.serial.write(&[byte]), Ok(1)) {
            self.unsent = Some(byte);
        }
    }

    /// The interrupt comes for each packet that has left.
    fn want_sent(&mut self, _sent: bool) {
        // Whether there is a packet under way already shows with its interrupt.
        let _ = self.serial.flush();
    }
}
