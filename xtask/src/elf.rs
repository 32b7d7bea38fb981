//! The little of the ELF format that sizes need: sections and symbols of a 32-bit little-endian
//! file.

/// A section that takes memory on the board.
#[derive(Clone, Debug)]
pub struct Section {
    /// Its address.
    pub address: u32,
    /// Its size in bytes.
    pub bytes: u32,
    /// Whether the file has its content, which then stands in flash.
    pub has_content: bool,
    /// Whether it is written to, so that it takes RAM.
    pub writable: bool,
}

/// A function or a variable.
#[derive(Clone, Debug)]
pub struct Symbol {
    /// Its mangled name.
    pub name: String,
    /// Its address; odd for a function, as the core wants it.
    pub address: u32,
    /// Its size in bytes.
    pub bytes: u32,
}

/// What a firmware's file says of memory.
#[derive(Clone, Debug)]
pub struct Image {
    /// Sections that are loaded.
    pub sections: Vec<Section>,
    /// Symbols that have a size.
    pub symbols: Vec<Symbol>,
}

const HEADER_SECTION_TABLE: usize = 0x20;
const HEADER_SECTION_COUNT: usize = 0x30;
const SECTION_HEADER_BYTES: usize = 40;
const SYMBOL_BYTES: usize = 16;
const TYPE_SYMBOL_TABLE: u32 = 2;
const TYPE_NO_CONTENT: u32 = 8;
const FLAG_WRITE: u32 = 1;
const FLAG_ALLOCATE: u32 = 2;

/// Reads the file's bytes; `None` if they are no 32-bit little-endian ELF file.
pub fn read(file: &[u8]) -> Option<Image> {
    const CLASS_32_LITTLE_ENDIAN: &[u8] = b"\x7fELF\x01\x01";
    if !file.starts_with(CLASS_32_LITTLE_ENDIAN) {
        return None;
    }
    let table = word(file, HEADER_SECTION_TABLE)? as usize;
    let count = usize::from(half(file, HEADER_SECTION_COUNT)?);
    let header = |index: usize| file.get(table + index * SECTION_HEADER_BYTES..);
    let mut image = Image {
        sections: Vec::new(),
        symbols: Vec::new(),
    };
    for index in 0..count {
        let at = header(index)?;
        let [kind, flags, address, offset, bytes, link] =
            [0x04, 0x08, 0x0C, 0x10, 0x14, 0x18].map(|field| word(at, field));
        let (kind, flags, offset, bytes) = (kind?, flags?, offset? as usize, bytes?);
        if flags & FLAG_ALLOCATE != 0 && bytes > 0 {
            image.sections.push(Section {
                address: address?,
                bytes,
                has_content: kind != TYPE_NO_CONTENT,
                writable: flags & FLAG_WRITE != 0,
            });
        }
        if kind == TYPE_SYMBOL_TABLE {
            let names = word(header(link? as usize)?, 0x10)? as usize;
            let symbols = file.get(offset..offset + bytes as usize)?;
            for symbol in symbols.chunks_exact(SYMBOL_BYTES) {
                let (name, address, bytes) = (word(symbol, 0)?, word(symbol, 4)?, word(symbol, 8)?);
                if bytes > 0 {
                    let name = file.get(names + name as usize..)?;
                    let end = name.iter().position(|byte| *byte == 0)?;
                    image.symbols.push(Symbol {
                        name: String::from_utf8_lossy(name.get(..end)?).into_owned(),
                        address,
                        bytes,
                    });
                }
            }
        }
    }
    Some(image)
}

impl Image {
    /// Bytes of flash: all content, that of initialised variables included.
    pub fn flash_bytes(&self) -> u32 {
        let content = self.sections.iter().filter(|section| section.has_content);
        content.map(|section| section.bytes).sum()
    }

    /// Bytes of RAM that variables take; the stack comes on top.
    pub fn ram_bytes(&self) -> u32 {
        let written = self.sections.iter().filter(|section| section.writable);
        written.map(|section| section.bytes).sum()
    }
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    let field = bytes.get(at..at + 4)?;
    Some(u32::from_le_bytes(field.try_into().ok()?))
}

fn half(bytes: &[u8], at: usize) -> Option<u16> {
    let field = bytes.get(at..at + 2)?;
    Some(u16::from_le_bytes(field.try_into().ok()?))
}
