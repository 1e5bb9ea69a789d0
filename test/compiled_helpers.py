"""What the functions call that the tests of the compiler compile."""


def doubled(number):
    return 2.0 * number
