//! USB as a wire of the link's line: a CDC device, so that the robot is a serial port of the
//! computer that it is plugged into, without an adapter.
//!
//! [`mod@line`](crate::line) has the queues around it. Nothing here waits for the host: what it
//! does not fetch stays in two packets and in the queue of the line, and the link sends no more
//! until there is room. Where nobody has the bus configured, the packet is dropped.

use heapless::Vec;
use usb_device::bus::{UsbBus, UsbBusAllocator};
use usb_device::device::{
    StringDescriptors, UsbDevice, UsbDeviceBuilder, UsbDeviceState, UsbVidPid,
};
use usbd_serial::{CdcAcmClass, USB_CLASS_CDC};

use crate::line::Wire;
use crate::speaker::Speaker;

/// Who makes it.
pub const MAKER: &str = "esm";

/// Bytes that a packet may have.
const PACKET_BYTES: usize = 64;
/// Bytes of a packet to the host. A packet that is not full ends a transfer: so the host hands on
/// each as it comes, and none needs an empty one behind it.
const SENT_BYTES: usize = PACKET_BYTES - 1;

/// The device, for its interrupt handler.
pub struct UsbWire<B: UsbBus + 'static>(pub &'static mut Device<B>);

/// The device, and its packets.
pub struct Device<B: UsbBus + 'static> {
    device: UsbDevice<'static, B>,
    serial: CdcAcmClass<'static, B>,
    /// A packet from the host, and how many of its bytes were taken.
    received: Vec<u8, PACKET_BYTES>,
    taken: usize,
    /// The next packet to the host.
    to_send: Vec<u8, SENT_BYTES>,
}

impl<B: UsbBus + 'static> Device<B> {
    /// The device on this bus, of this vendor and product, which says that it is this, or `None` if
    /// its texts are too long.
    pub fn new(
        bus: &'static UsbBusAllocator<B>,
        number: UsbVidPid,
        product: &'static str,
    ) -> Option<Self> {
        let serial = CdcAcmClass::new(bus, PACKET_BYTES as u16);
        let texts = StringDescriptors::default()
            .manufacturer(MAKER)
            .product(product);
        let device = UsbDeviceBuilder::new(bus, number)
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

impl<B: UsbBus + 'static> Wire for UsbWire<B> {
    const FIFO_BYTES: usize = PACKET_BYTES;

    fn acknowledge(&mut self) {
        let usb = &mut *self.0;
        usb.device.poll(&mut [&mut usb.serial]);
        if self.0.device.state() != UsbDeviceState::Configured {
            // It was for a host that is gone.
            self.0.to_send.clear();
        }
    }

    fn has_received(&mut self) -> bool {
        if self.0.taken == self.0.received.len() {
            self.0.taken = 0;
            self.0.received.clear();
            let mut packet = [0; PACKET_BYTES];
            if let Ok(count) = self.0.serial.read_packet(&mut packet) {
                // A packet fits.
                let _ = self
                    .0
                    .received
                    .extend_from_slice(packet.get(..count).unwrap_or_default());
            }
        }
        self.0.taken < self.0.received.len()
    }

    fn receive(&mut self) -> Option<u8> {
        if !self.has_received() {
            return None;
        }
        Speaker::Usb.speaks();
        let byte = self.0.received.get(self.0.taken).copied();
        self.0.taken += 1;
        byte
    }

    fn can_send(&mut self) -> bool {
        Speaker::Usb.is_answered()
            && self.0.device.state() == UsbDeviceState::Configured
            && !self.0.to_send.is_full()
    }

    fn send(&mut self, byte: u8) {
        // There is room: see `can_send`.
        let _ = self.0.to_send.push(byte);
    }

    /// The interrupt comes for each packet that has left, whether or not it is wanted.
    fn want_sent(&mut self, _sent: bool) {
        self.0.flush();
    }
}
