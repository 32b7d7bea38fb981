//! What the studio's page runs in its workers, as one WebAssembly module without imports.
//!
//! A call is a JSON object in, a JSON object out ([`calls`]). The page writes the request's bytes
//! where [`door`] says, calls, and reads the answer. Nothing here knows a clock: each request says
//! what the page's clock shows. A panic ends the instance; what the panic said is then in the
//! answer's place, and the page starts another instance.
//!
//! An instance runs one mission at most: its runtime lives as long as the instance, and the page
//! gives the memory back by letting go of the instance.

pub mod calls;
mod desk;
mod door;
mod drive;
mod files;
mod live;
mod looked;
mod recorded;
