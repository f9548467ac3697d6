//! A filter of static size takes no memory from the heap: alone in this program, since the count is of the whole process.

use std::alloc::System;

use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use vt_tests::estimators;

#[global_allocator]
static GLOBAL: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

#[test]
fn filters_of_static_size_allocate_nothing() {
    for (name, mut step) in estimators::cases() {
        // Mixtures of models fill their storage in the first step.
        (0..3).for_each(|_| step());
        let region = Region::new(GLOBAL);
        (0..50).for_each(|_| step());
        let change = region.change();
        assert_eq!(change.allocations + change.reallocations, 0, "{name}: {change:?}");
    }
}
