//! Read access to a packet, wherever it lies: a slice in user space, a helper call in the kernel.

/// A packet, or the part of it that holds one message.
pub trait Bytes {
    /// The number of bytes.
    fn len(&self) -> u32;

    /// Copies `N` bytes from `offset`; `None` where fewer are left.
    fn load<const N: usize>(&self, offset: u32) -> Option<[u8; N]>;

    /// Whether there is nothing to read.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

impl Bytes for [u8] {
    fn len(&self) -> u32 {
        u32::try_from(<[u8]>::len(self)).unwrap_or(u32::MAX)
    }

    fn load<const N: usize>(&self, offset: u32) -> Option<[u8; N]> {
        self.get(usize::try_from(offset).ok()?..)?
            .first_chunk()
            .copied()
    }
}
