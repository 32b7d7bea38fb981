//! The flash that missions are kept in: the plant's ([`mod@cortex_m_board::plant_flash`]).

cortex_m_board::plant_flash!(crate::Lm3s6965, crate::settings::BLOB_BYTES);
