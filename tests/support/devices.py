"""The OpenCL devices that the tests run on."""

from clfur.device import selection as device

DEVICES = device.find()
