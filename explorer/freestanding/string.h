/* What the kernel takes from the C library, as instructions of WebAssembly. */
#define memcpy __builtin_memcpy
#define memset __builtin_memset
