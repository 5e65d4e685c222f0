/* What the kernel takes from the C library, as instructions of WebAssembly. */
#define INFINITY __builtin_inf()
#define fabs __builtin_fabs
#define sqrt __builtin_sqrt
