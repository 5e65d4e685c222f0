/* What the kernel takes from the C library, as instructions of WebAssembly where it has them. */
#define INFINITY __builtin_inf()
#define fabs __builtin_fabs
#define sqrt __builtin_sqrt
/* The page gives this one. */
__attribute__((import_module("env"), import_name("atan2"))) double atan2(double y, double x);
