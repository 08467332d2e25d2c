"""Claims on gains: whether they hold, by which margin, up to which gains.

levels states them all, with passivity (L0 to L4), and level_claims what they claim and find, as data; hands is L5,
prove/ L7; certify puts them together for a table of gains, deployable is the one verdict before a device, own_law that
of a spring and damper of one's own, zwidth the walls that hold. Below these: worst_frequency (ideal devices, exactly),
impedance and port (devices as declared), llewellyn, engine_port.
"""
