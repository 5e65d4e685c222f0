/* Counts the instructions of a method, per call, on an emulated Cortex-M4F (QEMU, mps2-an386).
 *
 * With `-icount shift=6` an instruction takes 64 ns of virtual time, and the board's timer ticks
 * every 40 ns. So each call is counted to the instruction. `data.h` or `counted.h` has the vehicle;
 * the wrenches are loaded into memory by QEMU, their number first.
 */
#include <stdint.h>

#ifdef COUNT_EXPORTED
#include "counted.h"
typedef ca_real number;
#else
#include "methods.h"
#endif

#define REGISTER(address) (*(volatile uint32_t *)(address))
#define TIMER 0x40000000u /* CMSDK timer 0: control, value, reload; it counts down */
#define CPACR 0xE000ED88u
#ifndef MEMORY
#define MEMORY 0x21000000u
#endif
#define WRENCHES ((const uint32_t *)MEMORY)
#define STACK 0x20400000u

static void semihosting(int operation, const void *argument)
{
    register int r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
}

static void print(uint32_t number, char end)
{
    char text[12], *first = text + sizeof text;
    *--first = 0;
    *--first = end;
    do {
        *--first = (char)('0' + number % 10);
        number /= 10;
    } while (number);
    semihosting(4, first);
}

#ifdef COUNT_KERNEL
#include "exact.h"
static ca_problem problem;

static uint32_t start(void)
{
    static const ca_options options = OPTIONS;
    return (uint32_t)ca_set_up(&problem, CA_N, CA_M, &matrix[0][0], lower, upper, &options);
}

static int call(const number *u, number *f)
{
    return ca_allocate(&problem, u, f).status;
}
#elif defined COUNT_EXPORTED
static int call(const number *u, number *speeds)
{
#if COUNT_EXPORTED
    /* Within what the rotors reach from the last answer in 10 ms. */
    static number last[CA_N];
    (void)speeds;
    return counted_allocate_within(0, u, (number)0.01, last);
#else
    return counted_allocate(0, u, speeds);
#endif
}
#elif defined COUNT_VECTORED
#include "vectored.h"
static const ca_vectored problem[1] = {
#include "vectored_data.h"
};

static int call(const number *u, number *f)
{
    ca_vectored_answer answer;
    ca_vectored_allocate(problem, u, f, &answer);
    return answer.status;
}
#elif defined COUNT_DETECTOR
/* A call is a state and a command of the golden flight. */
#include "golden_flight.h"
static ca_detector detector;
static int row;

static uint32_t start(void)
{
    ca_detector_start(&detector, &MODEL);
    return 0;
}

static int call(const number *u, number *f)
{
    const int64_t time = (int64_t)row * 10000000;
    (void)u;
    (void)f;
    ca_detector_command(&detector, time, flight[row].speeds);
    ca_detector_observe(&detector, time, flight[row].state, flight[row].state + 4,
                        flight[row].state + 10);
    row++;
    return detector.health[0] < 1;
}
#elif defined WITH_OSQP
#define call osqp
#else
#define call clipped_pinv
#endif

#if !defined COUNT_KERNEL && !defined COUNT_DETECTOR
static uint32_t start(void)
{
    return 0;
}
#endif

static int nothing(const number *u, number *f)
{
    (void)u;
    (void)f;
    return 0;
}

static uint32_t instructions(int (*volatile method)(const number *, number *), const number *u,
                             int *status)
{
    number f[CA_N];
    const uint32_t before = REGISTER(TIMER + 4);
    *status = method(u, f);
    return (uint32_t)((uint64_t)(before - REGISTER(TIMER + 4)) * 40 / 64);
}

static void run(void)
{
    int status;
    REGISTER(CPACR) |= 0xFu << 20; /* the floating-point unit */
    __asm__ volatile("dsb\nisb");
    REGISTER(TIMER + 8) = REGISTER(TIMER + 4) = 0xFFFFFFFFu;
    REGISTER(TIMER) = 1;
    print(start(), '\n');
    const uint32_t size = WRENCHES[0];
    const number *u = (const number *)(WRENCHES + 2);
    const uint32_t empty = instructions(nothing, u, &status);
    for (uint32_t i = 0; i < size; i++, u += CA_M) {
        const uint32_t count = instructions(call, u, &status) - empty;
        print(count, ' ');
        print((uint32_t)status, '\n');
    }
    semihosting(0x18, (const void *)0x20026);
    for (;;)
        continue;
}

__attribute__((section(".vectors"), used)) static const uintptr_t vectors[16] = {
    STACK, (uintptr_t)run, (uintptr_t)run, (uintptr_t)run};
