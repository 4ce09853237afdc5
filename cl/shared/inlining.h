// What is compiled into its callers, and what is compiled once.
#ifndef MB_INLINING_H
#define MB_INLINING_H

// A function that takes or returns a vector. Doubles3 are wider than the registers of many CPUs,
// where calls would pass them through memory. (Oclgrind does not run what this makes of them.)
#ifndef INLINED
#define INLINED inline __attribute__((always_inline))
#endif

// Compiled once, however often it is called: copies of what is long would take PoCL a minute.
// Such a function takes vectors by address.
#define NOT_INLINED __attribute__((noinline))

// Clang tells of every call with such a vector that CPUs with wider registers would pass it in
// another way: of calls that it is about to inline, and of OpenCL's own built-ins. That matters
// where caller and callee are compiled for different CPUs, and here both are for one.
#ifdef __has_warning
#if __has_warning("-Wpsabi")
#pragma clang diagnostic ignored "-Wpsabi"
#endif
#endif

#endif
