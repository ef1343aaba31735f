"""Describe logs for help and errors: the readable formats, and the columns that `csv_log` reads.

Importing this module does not import NumPy.
"""

from auvbench import integrations

READABLE = ", ".join([".csv", *(title for title, _ in integrations.LOGS.values())])
"""Log formats that can be read, apart from auvbench's own records."""
DESCRIBED = (
    (("t_s", "t_ms", "t_us"), "time, increasing (one of the three)"),
    (
        ("NAME_us", "NAME_cmd", "NAME_N"),
        "input of each actuator: pulse width (1500 is neutral), command (-1 to 1) or thrust",
    ),
    (("Fx_N", "Fy_N", "Fz_N", "Mx_Nm", "My_Nm", "Mz_Nm"), "or the wrench on the body"),
    (("x_m", "y_m", "z_m", "depth_m"), "position, z up; a depth in place of z"),
    (("roll_rad", "pitch_rad", "yaw_rad"), "attitude; _deg for degrees"),
    (("qw", "qx", "qy", "qz"), "or the attitude as a quaternion, body to world"),
    (("u_mps", "v_mps", "w_mps"), "velocity in body axes: forward, port, up"),
    (("p_radps", "q_radps", "r_radps"), "rates in body axes; _degps for degrees"),
    (("ax_mps2", "ay_mps2", "az_mps2"), "specific force, used only for checks"),
    (("voltage_V",), "supply of the thrusters"),
)
"""Groups of columns of a CSV log, each with its meaning."""
