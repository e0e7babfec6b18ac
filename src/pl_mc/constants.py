"""Physical and conventional constants, each with its source."""

# IS-GPS-200, section 20.3.4.3 (and BeiDou OS ICD): speed of light in vacuum, exact by definition of the metre.
SPEED_OF_LIGHT_M_S = 299_792_458.0

# WGS 84 (IS-GPS-200 table 20-IV): Earth's gravitational parameter and rotation rate as GPS users compute with.
EARTH_GM_M3_S2 = 3.986005e14
EARTH_ROTATION_RAD_S = 7.2921151467e-5

# Carrier frequencies: IS-GPS-200 (L1), IS-GPS-705 (L5), Galileo OS SIS ICD (E1, E5a), BDS-SIS-ICD-2.1 (B1I).
FREQUENCY_L1_HZ = 1_575.42e6
FREQUENCY_L5_HZ = 1_176.45e6
FREQUENCY_B1I_HZ = 1_561.098e6

# BeiDou time began on 2006-01-01 without leap seconds, 14 s after GPS time (BDS-SIS-ICD-2.1, 3.3).
BDT_BEHIND_GPS_S = 14.0

# RTCA DO-229, appendix A.4.4.10: Earth radius and thin-shell height of the ionospheric obliquity factor.
EARTH_RADIUS_DO229_M = 6_378_136.3
IONOSPHERE_SHELL_HEIGHT_M = 350_000.0

# Zhao et al. 2021, after Blanch et al. 2015: normal quantiles for the integrity risks 1e-7 (vertical, 5.33) and
# 5e-9 (horizontal, 6.18). Q^-1(5e-8) = 5.326724, sqrt(-2 ln 5e-9) = 6.182852.
K_VERTICAL = 5.33
K_HORIZONTAL = 6.18

# Satellites that the names of a system can number, by RINEX letter (G07).
MOST_SATELLITES = {"G": 32, "C": 63, "E": 36, "R": 27, "J": 10}

# Standard deviations of pseudoranges beyond these are a slip of the unit, and weights cannot be computed with [m].
LEAST_SIGMA_M, MOST_SIGMA_M = 1e-9, 1e9

# Places of the components of a position error, and of the first columns of a design matrix.
EAST, NORTH, UP = 0, 1, 2
