"""The OpenCL devices that the tests run on."""

from clfur import device

DEVICES = device.find()
