/* What all parts of the kernel share. */

#ifndef KERNEL_H
#define KERNEL_H

/* Python builds with -fwrapv, with which gcc does not vectorise a loop whose counter is an int: a
   front's substitution then takes 1.8 times as long, a plane scan 5 % longer. */
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC optimize("O3", "no-wrapv")
#endif

/* Compiled for wide registers too where the compiler can choose at run time. */
#if __GNUC__ >= 12 && !defined(__clang__) && defined(__x86_64__) && defined(__gnu_linux__)
#define FAST __attribute__((target_clones("arch=x86-64-v3", "default")))
#else
#define FAST
#endif

#endif
