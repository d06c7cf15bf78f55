/* What all parts of the kernel share. */

#ifndef KERNEL_H
#define KERNEL_H

#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC optimize("O3")
#endif

/* Compiled for wide registers too where the compiler can choose at run time. */
#if __GNUC__ >= 12 && !defined(__clang__) && defined(__x86_64__) && defined(__gnu_linux__)
#define FAST __attribute__((target_clones("arch=x86-64-v3", "default")))
#else
#define FAST
#endif

#endif
