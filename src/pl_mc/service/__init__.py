"""Service volume: users all over the Earth and all day, and where which method's levels serve which operation.

`pl_mc.service_volume` is in `pl_mc.service.volume`.
"""
