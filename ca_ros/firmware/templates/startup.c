/* Start-up of the check on the boards mps2-an386 (Cortex-M4F) and mps2-an500 (Cortex-M7) of QEMU,
 * which has loaded all memory. A flight controller has its own. */
#ifdef __arm__ /* so that a host can compile all files of the folder */

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#define CPACR (*(volatile uint32_t *)0xE000ED88)

extern uint32_t stack_top[];
int main(void);
void initialise_monitor_handles(void);
void reset(void);

void reset(void)
{
    CPACR |= 0xFu << 20; /* the floating-point unit */
    __asm__ volatile("dsb\n\tisb");
    initialise_monitor_handles();
    const int status = main();
    fflush(stdout);
    _Exit(status);
}

static void stop(void)
{
    _Exit(2);
}

__attribute__((section(".vectors"), used)) static const struct {
    uint32_t *stack;
    void (*handlers[15])(void);
} vectors = {stack_top, {reset, stop, stop, stop, stop, stop, stop, stop, stop, stop, stop, stop,
                         stop, stop, stop}};

#else
typedef int no_board; /* no file is empty in C */
#endif
