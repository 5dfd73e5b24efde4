#pragma once
// Functions that are compiled twice, for vectors of two and of four doubles. Both variants compute
// the same doubles, because neither uses a fused multiply-add.

namespace forceaxis::sim {

#if defined(__x86_64__)
#define FORCEAXIS_WIDE [[gnu::target("avx2")]]
/// True if this processor can execute functions with the attribute FORCEAXIS_WIDE.
inline const bool kWide = __builtin_cpu_supports("avx2") != 0;
#else
#define FORCEAXIS_WIDE
inline const bool kWide = false;
#endif

}  // namespace forceaxis::sim
