//! The writer's HistoryCache and the changes in it (RTPS 2.5 sections 8.2.2 and 8.2.3).
//!
//! Changes are ordered by sequence number; those of one instance are also linked to each other, so that
//! KEEP_LAST finds the one to replace without a search.

mod cache;
mod change;
mod changes;
mod instances;
mod membership;

pub use cache::{Entry, HistoryCache};
pub use change::{CacheChange, ChangeKind, NewChange};
pub use instances::Instance;
pub use membership::{GroupStamp, Membership};
