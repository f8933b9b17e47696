"""The errors of the library."""


class Error(ValueError):
    """Something that the user gave cannot be used; the message is one clear line.

    It names what was wrong and where (such as `HairType.segments`), the value, and what is allowed.
    """


class DeviceError(Error):
    """A device or its driver failed: a kernel does not build, memory is out, the device is lost.

    The message names the device, what it was doing, and the kernel's file and line where the driver tells them.
    """
