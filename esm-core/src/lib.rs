#![no_std]
//! Extended state machines for microcontrollers.
